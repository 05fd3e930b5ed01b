# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar odometry: registration of each sweep with the local map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.clock import NS_PER_S
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import rotate_covariance
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import LidarScan
from cdff_core.dfns.point_cloud_deskewing.interface import PointCloudDeskewingInputs
from cdff_core.dfns.scan_to_map_registration.interface import (
    ScanToMapRegistrationInputs,
    ScanToMapRegistrationOutputs,
)
from cdff_core.dfpcs.lidar_slam.configuration import LidarSlamConfig
from cdff_core.dfpcs.lidar_slam.degenerate_directions import degenerate_directions
from cdff_core.dfpcs.lidar_slam.motion_predictor import MotionPredictor, Prediction
from cdff_core.dfpcs.lidar_slam.motion_uncertainty import MotionUncertainty, growth
from cdff_core.dfpcs.lidar_slam.rotation_search import SupportMonitor, rotations_about_lidar_axis

Float = NDArray[np.float64]

#: Standard deviations of the predicted motion during a sweep: translation, metres, and rotation, radians.
_SWEEP_SIGMA = np.array([0.03] * 3 + [0.012] * 3)
#: Standard deviations of the motion relative to a searched rotation, since the previous sweep and during this
#: one: translation, metres, and rotation, radians.
_SEARCH_SIGMA = np.array([1.0] * 3 + [0.1] * 3)
_SEARCH_SWEEP_SIGMA = np.array([0.1] * 3 + [0.1] * 3)
#: Number of successive lost sweeps that are not added to the local map; later ones are added, and the map
#: continues at the predicted pose.
_WITHHELD_SWEEPS = 5
#: Number of successive sweeps with an unconstrained direction beyond which the prior is not weakened further.
_MAX_PRIOR_SWEEPS = 20
#: Fraction of points on the local map below which a sweep does not match.
_LOST_INLIER_RATIO = 0.05
#: Path length over which a new local map constrains poses poorly, since all its sweeps are from one position.
_INITIAL_PATH_M = 5.0
#: Additional covariance of a pose at the start of this initial path, relative to the covariance of later
#: poses.
_INITIAL_NOISE = 10.0
#: Additional covariance of the drift per metre on the initial path, relative to the covariance of a pose.
_INITIAL_DRIFT = 0.75
#: Path length after which the calibration error of the lidar has an independent effect on poses: by then the
#: near ground, which constrains the pose most, consists of other voxels.
_CALIBRATION_RENEWAL_M = 1.0
#: Weight of the map along a degenerate direction below which the prediction determines the pose.
_MEASURED_GAIN = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class TrackingResult:
    """One sweep registered with the local map."""

    T_odom_lidar: Float  # (4, 4), at the end of the sweep
    #: ``T_previous_current`` since the previous sweep, with the covariance that accumulates as drift
    increment: UncertainTransform
    #: (6, 6), covariance of this pose alone, in the lidar's axes. It does not accumulate, since the next
    #: sweep is registered with the map independently.
    pose_covariance: Float
    points_m: Float  # (n, 3), deskewed, in the lidar's frame at the end of the sweep
    #: None for the first sweep, and without overlap. If the sweep is lost, the pose is not that of the
    #: registration.
    registration: ScanToMapRegistrationOutputs | None
    #: The pose is the prediction: the sweep does not match the map, or no sweep had points within range so
    #: far.
    is_lost: bool
    used_odometry: bool  # the motion was predicted from the odometry port
    is_mount_assumed: bool = False  # odometry was used although the mount of the lidar is unknown

    def with_pose_covariance(self, T: UncertainTransform) -> UncertainTransform:
        """Return a pose of the lidar with ``pose_covariance`` added to its covariance."""
        return T @ UncertainTransform(np.eye(4), self.pose_covariance)


class ScanTracker:
    """Estimates lidar odometry; the registration DFN contains the local map."""

    def __init__(
        self,
        config: LidarSlamConfig,
        deskewing: Dfn[Any, Any, Any],
        registration: Dfn[Any, Any, Any],
        predictor: MotionPredictor,
    ) -> None:
        self._config, self._deskewing, self._registration = config, deskewing, registration
        self.predictor = predictor
        self._T = np.eye(4)
        self._stamp_ns: int | None = None
        self._velocity = np.zeros(6)  # of the lidar in its own axes, per second
        self._uncertainty, self._support = MotionUncertainty(), SupportMonitor()
        self._unconstrained_sweeps = 0  # successive sweeps with a degenerate direction
        self._lost_sweeps = 0  # successive sweeps that do not match the map
        self._path_length_m = 0.0  # since the start of the local map
        self._new_map_points: Float | None = None  # points that the next registration adds to the local map

    def start_on_map(self, T_odom_lidar: Float, points_m: Float) -> None:
        """Start at a pose in an existing map, given as points (n, 3) in the odometry frame."""
        self._T, self._new_map_points = T_odom_lidar.copy(), points_m
        self._path_length_m = _INITIAL_PATH_M

    def track(self, scan: LidarScan) -> TrackingResult:
        """Register a sweep with the local map, which the first sweep with points within range starts.

        A sweep without points within range is lost.
        """
        is_first = self._stamp_ns is None and self._new_map_points is None
        points_m, point_times = self._select(scan)
        prediction = self._predict(scan)
        registration = None if is_first else self._register_or_search(points_m, point_times, prediction)
        is_accepted = registration is not None and registration.inlier_ratio >= _LOST_INLIER_RATIO
        accepted = registration if is_accepted else None
        T_previous, T_end_start = self._T, prediction.T_end_start
        if accepted is not None:
            self._T, T_end_start = np.array(accepted.transform), accepted.sweep
        elif not is_first:
            self._T = T_previous @ prediction.T_previous_current
        self._T[:3, :3] = se3.normalise_rotation(self._T[:3, :3])
        increment = se3.inverse(T_previous) @ self._T
        deskewed_m = self._deskew(points_m, point_times, T_end_start)
        drift, pose_covariance = np.zeros((6, 6)), np.zeros((6, 6))
        if not is_first:
            predicted_covariance = rotate_covariance(prediction.covariance, T_previous[:3, :3])
            drift, pose_covariance = self._update_covariances(
                accepted, predicted_covariance, increment, prediction.used_odometry
            )
        if self._stamp_ns is not None:
            self._velocity = se3.vector_from_transform(increment) / prediction.interval_s
        self._lost_sweeps = 0 if is_first or accepted is not None else self._lost_sweeps + 1
        if accepted is not None:
            self._support.update(accepted.support_ratio)
            if not self._unconstrained_sweeps and not prediction.used_odometry:
                error = se3.inverse(prediction.T_previous_current) @ increment
                self._uncertainty.update(se3.vector_from_transform(error), prediction.interval_s)
        is_withheld = 0 < self._lost_sweeps <= _WITHHELD_SWEEPS
        is_empty_start = is_first and not len(points_m)  # the next sweep then starts the local map
        self._stamp_ns = None if is_empty_start else scan.t1_ns
        is_added = not is_withheld and not is_empty_start
        self._new_map_points = se3.transform_points(self._T, deskewed_m) if is_added else None
        return TrackingResult(
            T_odom_lidar=self._T.copy(),
            increment=UncertainTransform(increment, rotate_covariance(drift, T_previous[:3, :3].T)),
            pose_covariance=rotate_covariance(pose_covariance, self._T[:3, :3].T),
            points_m=deskewed_m,
            registration=registration,
            is_lost=is_empty_start or (not is_first and accepted is None),
            used_odometry=prediction.used_odometry,
            is_mount_assumed=prediction.used_odometry and not self.predictor.is_mount_known,
        )

    def _select(self, scan: LidarScan) -> tuple[Float, Float]:
        """Return the points within range and their times: -1 at the start of the sweep, 0 at its end."""
        points = np.asarray(scan.points_m, dtype=np.float64)
        squared_range_m2 = np.einsum("ij,ij->i", points, points)
        # NaN fails both comparisons.
        is_near = (squared_range_m2 > self._config.min_range_m**2) & (
            squared_range_m2 < self._config.max_range_m**2
        )
        duration_us = (scan.t1_ns - scan.t0_ns) / 1000.0
        if duration_us <= 0.0:
            return points[is_near], np.zeros(int(is_near.sum()))
        point_times = np.asarray(scan.time_offset_us, dtype=np.float64)[is_near] / duration_us - 1.0
        return points[is_near], np.minimum(point_times, 0.0)

    def _predict(self, scan: LidarScan) -> Prediction:
        """Predict the motion to the end of a sweep; the robot may already move during its first sweep."""
        if self._stamp_ns is None and (velocity := self.predictor.velocity(scan.t1_ns)) is not None:
            self._velocity = velocity
        return self.predictor.predict(scan, self._stamp_ns, self._velocity, self._uncertainty)

    def _register_or_search(
        self, points_m: Float, point_times: Float, prediction: Prediction
    ) -> ScanToMapRegistrationOutputs | None:
        """Register from the prediction, or search the rotation if fewer points than expected lie on the map.

        The search is over all rotations about the z axis of the lidar. It first assumes a constant rate since
        the previous sweep, then a rotation within this sweep only.
        """
        sweeps = min(self._unconstrained_sweeps, _MAX_PRIOR_SWEEPS)
        since_measurement, _ = growth(sweeps, by_odometry=prediction.used_odometry)
        best = self._register(
            points_m,
            point_times,
            prediction,
            since_measurement * prediction.covariance,
            _SWEEP_SIGMA,
            new_map_points=self._new_map_points,
        )
        sweep_fractions = [prediction.sweep_fraction]
        if prediction.sweep_fraction is not None and prediction.sweep_fraction < 1.0 and np.any(point_times):
            sweep_fractions.append(1.0)
        alternative_guesses = rotations_about_lidar_axis(self._T @ prediction.T_previous_current)
        for sweep_fraction in sweep_fractions:
            support = 0.0 if best is None else best.support_ratio
            if not self._support.is_low(support):
                break
            registration = self._register(
                points_m,
                point_times,
                replace(prediction, sweep_fraction=sweep_fraction),
                np.diag(_SEARCH_SIGMA**2),
                _SEARCH_SWEEP_SIGMA,
                alternative_guesses=alternative_guesses,
            )
            if registration is not None and self._support.is_better(registration.support_ratio, support):
                best = registration
        return best

    def _register(
        self,
        points_m: Float,
        point_times: Float,
        prediction: Prediction,
        covariance: Float,
        sweep_sigma: Float,
        *,
        new_map_points: Float | None = None,
        alternative_guesses: Float | None = None,
    ) -> ScanToMapRegistrationOutputs | None:
        """Estimate the pose and the motion during the sweep together; None without overlap."""
        guess = self._T @ prediction.T_previous_current
        sweep_fraction = prediction.sweep_fraction
        try:
            registration: ScanToMapRegistrationOutputs = self._registration.process(
                ScanToMapRegistrationInputs(
                    new_map_points=new_map_points,
                    points=points_m,
                    point_times=point_times,
                    guess=se3.normalise_transform(guess),
                    sweep_guess=prediction.T_end_start,
                    guess_covariance=rotate_covariance(covariance, self._T[:3, :3]),
                    sweep_covariance=np.diag(sweep_sigma**2),
                    previous_pose=None if sweep_fraction is None else self._T,
                    sweep_fraction=sweep_fraction,
                    alternative_guesses=alternative_guesses,
                )
            )
        except RefusedError:
            return None
        return registration

    def _deskew(self, points_m: Float, point_times: Float, T_end_start: Float) -> Float:
        """Return the points in the lidar's frame at the end of the sweep."""
        poses = np.array([se3.normalise_transform(T_end_start), np.eye(4)])
        stamps_ns = np.clip(np.round((point_times + 1.0) * NS_PER_S), 0, NS_PER_S).astype(np.int64)
        deskewed: Float = self._deskewing.process(
            PointCloudDeskewingInputs(
                points=points_m,
                stamps_ns=stamps_ns,
                pose_stamps_ns=np.array([0, NS_PER_S]),  # duration of the sweep as one second
                poses=poses,
            )
        ).points
        return deskewed

    def _update_covariances(
        self,
        registration: ScanToMapRegistrationOutputs | None,
        predicted_covariance: Float,
        increment: Float,
        used_odometry: bool,
    ) -> tuple[Float, Float]:
        """Return the drift during a sweep and the covariance of its pose, both in axes of the odometry frame.

        The path length and the number of successive sweeps with a degenerate direction are updated.

        Along constrained directions, the covariance of the pose is the sum of a floor and of the two
        covariances of the registration, times their configured ratios; per metre of path,
        ``noise.drift_ratio`` of it is added as drift. With a new local map, both are larger until the lidar
        has moved.

        The calibration of the lidar adds its covariance to that of the pose, and once per
        ``_CALIBRATION_RENEWAL_M`` to the drift: after this path length, the rings cross other ground, so that
        the same error has another effect.

        Along degenerate directions, the pose drifts by the part of the covariance of the prediction that the
        map does not reduce; prediction errors are correlated from sweep to sweep (``growth``).
        """
        c = self._config
        degenerate = degenerate_directions(registration, c.gates.degenerate_sigma_m)
        constrained = np.eye(6) - degenerate.projection(np.ones(len(degenerate.gains)))
        pose_covariance, calibration = np.zeros((6, 6)), np.zeros((6, 6))
        if registration is not None:
            floor = np.square([c.noise.floor_m] * 3 + [c.noise.floor_rad] * 3)
            covariance = c.noise.ratio * registration.covariance + np.diag(floor)
            covariance += c.noise.residual_ratio * registration.residual_covariance
            pose_covariance = constrained @ covariance @ constrained.T
            calibration = constrained @ registration.calibration_covariance @ constrained.T
        path_m = float(np.linalg.norm(increment[:3, 3]))
        self._path_length_m += path_m
        newness = max(0.0, 1.0 - self._path_length_m / _INITIAL_PATH_M)  # of the local map, 1 to 0
        drift_ratio = c.noise.drift_ratio + (_INITIAL_DRIFT if newness > 0.0 else 0.0)
        _, last_growth = growth(self._unconstrained_sweeps, by_odometry=used_odometry)
        unmeasured = degenerate.projection(1.0 - degenerate.gains)
        prediction_drift = last_growth * (unmeasured @ predicted_covariance @ unmeasured.T)
        is_predicted = np.any(degenerate.gains < _MEASURED_GAIN)
        self._unconstrained_sweeps = self._unconstrained_sweeps + 1 if is_predicted else 0
        path_drift = path_m * (drift_ratio * pose_covariance + calibration / _CALIBRATION_RENEWAL_M)
        pose_covariance = (1.0 + _INITIAL_NOISE * newness**2) * pose_covariance
        return path_drift + prediction_drift, pose_covariance + calibration + degenerate.covariance
