# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction of a predicted state by the points of a scan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfns.model_registration.interface import ModelRegistrationInputs
from cdff_core.dfns.point_cloud_deskewing.interface import PointCloudDeskewingInputs
from cdff_core.object_models.scan_detection import surface_ports
from cdff_core.object_models.tracked_state import STATE_ERROR_DIM, TrackedState

#: Largest rotation of the body between two poses of the motion correction, rad, and largest number of poses.
_STEP_RAD, _MAX_POSES = math.radians(0.5), 200
#: The motion correction is repeated while the correction of the rate changes the rotation during the scan by
#: more than this, at most this number of times.
_RESIDUAL_MOTION_RAD, _MAX_ROUNDS = math.radians(0.05), 4
#: Bounds of the capture range, in diameters, and number of standard deviations of the prediction that the
#: range covers.
_MIN_CAPTURE, _MAX_CAPTURE, _SIGMAS = 0.05, 0.25, 3.0


@dataclass(frozen=True, slots=True, eq=False)
class ScanFit:
    """A corrected state and how well the scan agrees with it.

    Attributes
    ----------
    state : TrackedState
    distance : float
        Squared Mahalanobis distance of the correction from the prediction.
    agreement : float
        Fraction of the points near the body that agree with the model.
    sigma_m : float
        Robust standard deviation of the range differences.
    weak_directions : ndarray, shape (j, 6)
        Directions that the scan does not constrain.
    points : int
        Points near the body.
    in_front : float
        Fraction of the points that meet the model whose range is shorter.
    """

    state: TrackedState
    distance: float
    agreement: float
    sigma_m: float
    weak_directions: FloatArray
    points: int
    in_front: float


class ScanFitter:
    """Fit of a state to scans of a prepared model.

    Parameters
    ----------
    deskew : Dfn or None
        PointCloudDeskewing; None if all points of a scan have the time of its stamp.
    register : Dfn
        ModelRegistration.
    """

    def __init__(self, deskew: Dfn[Any, Any, Any] | None, register: Dfn[Any, Any, Any]) -> None:
        self._deskew, self._register = deskew, register

    def fit(
        self,
        model: ModelPreparationOutputs,
        predicted: TrackedState,
        points_m: FloatArray,
        times_s: FloatArray,
        sigma_m: float,
        delay_sigma_s: float = 0.0,
    ) -> ScanFit:
        """Return the state corrected by points (n, 3) at times (n,) relative to its stamp.

        ``delay_sigma_s`` is the standard deviation of an unknown delay of all points, by which the body moves
        on with its velocity; it is estimated with the state.

        Raises
        ------
        RefusedError
            ``no_overlap`` or ``sensor_inside``.
        """
        is_near_body = near_body(model, predicted, points_m, times_s)
        points_m, times_s = points_m[is_near_body], times_s[is_near_body]
        duration_s = float(np.ptp(times_s)) if len(times_s) else 0.0
        state, J = predicted, pose_and_rate_jacobian(predicted)
        prior = predicted.covariance
        if delay_sigma_s > 0.0:
            delay = np.concatenate([predicted.velocities, np.zeros(6)])
            J, prior = np.hstack([J, delay[:, None]]), np.pad(prior, (0, 1))
            prior[-1, -1] = delay_sigma_s**2
        for _ in range(_MAX_ROUNDS if duration_s > 0.0 else 1):
            moved_m = self._move_points(state, points_m, times_s)
            outputs = self._register.process(
                ModelRegistrationInputs(
                    scan=moved_m,
                    times_s=times_s,
                    pose=state.T,
                    prior_covariance=prior,
                    prior_error=np.pad(predicted.difference(state), (0, len(prior) - STATE_ERROR_DIM)),
                    state_jacobian=J,
                    capture_m=_capture_m(model, predicted),
                    drawn_vertices=model.drawn_vertices,
                    drawn_triangles=model.drawn_triangles,
                    centre_m=model.centre_m,
                    sigma_m=sigma_m,
                    **surface_ports(model),
                )
            )
            state = state.corrected(
                outputs.correction[:STATE_ERROR_DIM], outputs.covariance[:STATE_ERROR_DIM, :STATE_ERROR_DIM]
            )
            if float(np.linalg.norm(outputs.correction[9:12])) * duration_s < _RESIDUAL_MOTION_RAD:
                break
        distance = state.squared_distance(predicted)
        return ScanFit(
            state,
            distance,
            outputs.agreement,
            outputs.sigma_m,
            outputs.weak_directions,
            len(points_m),
            outputs.in_front,
        )

    def _move_points(self, state: TrackedState, points_m: FloatArray, times_s: FloatArray) -> FloatArray:
        """Return the points (n, 3) moved with the body to the time of the state."""
        if self._deskew is None or not times_s.any():
            return points_m
        low_s, high_s = min(float(times_s.min()), 0.0), max(float(times_s.max()), 0.0)
        rotation = float(np.linalg.norm(state.rate)) * (high_s - low_s)
        knots_s = np.linspace(low_s, high_s, min(2 + int(rotation / _STEP_RAD), _MAX_POSES))
        stamps_ns = np.rint(1e9 * knots_s).astype(np.int64)
        outputs = self._deskew.process(
            PointCloudDeskewingInputs(
                points=points_m,
                stamps_ns=np.clip(np.rint(1e9 * times_s).astype(np.int64), stamps_ns[0], stamps_ns[-1]),
                poses=se3.inverse(state.relative_poses(knots_s)),
                pose_stamps_ns=stamps_ns,
            )
        )
        return np.asarray(outputs.points @ state.T[:3, :3].T + state.T[:3, 3])


def near_body(
    model: ModelPreparationOutputs, state: TrackedState, points_m: FloatArray, times_s: FloatArray
) -> np.ndarray:
    """Return the mask (n,) of points within the radius of the body and the uncertainty of its centre."""
    centre, radius_m = body_ball(model, state)
    centres = centre + np.outer(times_s, state.velocity)
    return np.asarray(np.linalg.norm(points_m - centres, axis=1) < radius_m)


def body_ball(model: ModelPreparationOutputs, state: TrackedState) -> tuple[FloatArray, float]:
    """Return centre (3,) and radius of the ball with the body and the uncertainty of its centre."""
    arm = state.T[:3, :3] @ model.centre_m
    J = np.hstack([np.eye(3), -se3.skew(arm)])
    sigma_m = math.sqrt(float(np.linalg.eigvalsh(J @ state.covariance[:6, :6] @ J.T)[-1]))
    radius_m = 0.6 * model.diameter_m + min(_SIGMAS * sigma_m, model.diameter_m)
    return arm + state.T[:3, 3], radius_m


def pose_and_rate_jacobian(state: TrackedState) -> FloatArray:
    """Return the derivative (12, 15) of the errors of the pose and of their rates at the stamp.

    The attitude a time t later has the error phi + t R dw; the position that of the velocity of the origin.
    """
    R = state.T[:3, :3]
    J = np.zeros((12, STATE_ERROR_DIM))
    J[:6, :6] = np.eye(6)
    J[6:9] = state.velocity_jacobian[:3]
    J[9:, 9:12] = R
    return J


def capture_limit(model: ModelPreparationOutputs) -> float:
    """Return the largest error of the start, metres, from which a registration converges."""
    return _MAX_CAPTURE * model.diameter_m


def _capture_m(model: ModelPreparationOutputs, predicted: TrackedState) -> float:
    variances = np.diag(predicted.covariance)
    position_m = math.sqrt(float(variances[:3].max()))
    rotation_m = 0.5 * model.diameter_m * math.sqrt(float(variances[3:6].max()))
    d = model.diameter_m
    return min(max(_SIGMAS * (position_m + rotation_m), _MIN_CAPTURE * d), capture_limit(model))
