# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The error-state filter: predict by the IMU, correct by increments of odometries and by absolute fixes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.kalman_correction._interface import KalmanCorrectionInputs
from cdff_core.dfns.kalman_prediction._interface import KalmanPredictionInputs
from cdff_core.dfns.odometry_increment._interface import OdometryIncrementInputs
from cdff_core.dfns.pose_weighting._interface import PoseWeightingInputs
from cdff_core.dfpcs.position_manager.buffers import ImuBuffer
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import CORE, LINE, POSE, SLIP, VELOCITY, Clone, Estimate

#: Longest step of the strapdown integration, nanoseconds.
_STEP_NS = 200_000_000
#: How far a robot may have gone, and turned, while nobody spoke: beyond it numbers lose their digits, and angles their
#: meaning (a heading of which nothing is known).
_LOST_M, _LOST_RAD = 1e4, math.pi / math.sqrt(3.0)
_EXACT = np.zeros((6, 6))
#: Ports whose measurements are absolute poses.
FIXES = ("fix", "absolute_fix")


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """A measurement in the order of time.

    Attributes
    ----------
    source : str
        ``odometry``, ``visual_odometry``, ``lidar_odometry``, ``fix``, ``absolute_fix``, or ``imu`` for a time at which
        to estimate.
    measured : UncertainTransform, optional
        What it says: ``T_origin_sensor``.
    frame, child : str
        Origin and sensor.
    scale : float
        Of its variances.
    afresh : bool
        Whether the increment to it is not to be taken: the pose before it is lost or of another count.
    """

    stamp_ns: int
    source: str
    measured: UncertainTransform | None = None
    frame: str = ""
    child: str = ""
    scale: float = 1.0
    afresh: bool = False


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a measurement: taken, attached to (where its next increment counts from) or refused."""

    taken: bool
    reasons: tuple[str, ...] = ()


class Estimator:
    """Estimates from estimates; holds no state but the DFNs.

    Parameters
    ----------
    dfn : callable
        Gives the DFN of a slot.
    mount : callable
        ``T_base_sensor`` of a sensor's frame at a time.
    place : callable
        ``T_site_frame`` of a fixed frame; None where it hangs nowhere in the tree.
    """

    def __init__(
        self,
        config: PositionManagerConfig,
        dfn: Callable[[str], Dfn[Any, Any, Any]],
        imu: ImuBuffer,
        mount: Callable[[str, int], FloatArray],
        place: Callable[[str], FloatArray | None],
    ) -> None:
        self.config, self.imu, self._mount, self._place = config, imu, mount, place
        self._prediction, self._correction = dfn("prediction"), dfn("correction")
        self._fix_correction, self._weighting = dfn("fix_correction"), dfn("weighting")
        self._increments = {
            "odometry": dfn("wheel_increment"),
            "visual_odometry": dfn("visual_increment"),
            "lidar_odometry": dfn("lidar_increment"),
        }
        #: Strength of gravity, m/s^2; None until it was felt.
        self.gravity_m_s2: float | None = None
        self.lever_m = np.zeros(3)

    def after(self, estimate: Estimate, event: Event) -> tuple[Estimate, Verdict]:
        """The estimate at an event's time, with what it measured."""
        if event.stamp_ns > estimate.stamp_ns:
            estimate = replace(estimate, since=estimate.covariance[:, LINE])
        estimate = self.predict(estimate, event.stamp_ns)
        if event.measured is None:
            return estimate, Verdict(True)
        if event.source in FIXES:
            return self._fixed(estimate, event)
        clone = estimate.clones.get(event.source)
        measured = event.measured
        if clone is None or event.afresh or self._begun_anew(event, clone):
            return estimate.cloned(event.source, measured), Verdict(False, (f"{event.source}_attached",))
        if estimate.refused >= self.config.refusals:
            estimate = _doubted(estimate, self.config.unknown_speed_sigma_m_s)
        try:
            estimate = self._stepped(estimate, event, clone.measured)
        except RefusedError as error:
            estimate = replace(estimate, refused=estimate.refused + 1).cloned(event.source, measured)
            return estimate, Verdict(False, (f"{event.source}_refused", *error.reasons))
        return replace(estimate, refused=0).cloned(event.source, measured), Verdict(True)

    def ahead(self, estimate: Estimate, stamp_ns: int) -> Estimate:
        """The estimate of a later time, linked to this one."""
        return self.predict(replace(estimate, since=estimate.covariance[:, LINE]), stamp_ns)

    def predict(self, estimate: Estimate, stamp_ns: int) -> Estimate:
        """Move on to a time that is not before the estimate's."""
        if stamp_ns - estimate.stamp_ns > self.config.blind_s * 1e9:
            return self._blind(estimate, stamp_ns)
        while estimate.stamp_ns < stamp_ns:
            estimate = self._predicted(estimate, min(stamp_ns, estimate.stamp_ns + _STEP_NS))
        return estimate

    def _blind(self, estimate: Estimate, end_ns: int) -> Estimate:
        """Over a time in which nobody spoke, in one step: it stood still for all that is known, and may be anywhere."""
        before = estimate.covariance[POSE, POSE]
        still = _doubted(replace(estimate, velocity=np.zeros(3)), 0.0)
        after = self._predicted(still, end_ns)
        P = after.covariance.copy()
        lost = np.diag(np.square([_LOST_M] * 3 + [_LOST_RAD] * 3))
        P[POSE, POSE] = before + np.minimum(P[POSE, POSE] - before, lost)
        return _doubted(replace(after, covariance=P), self.config.unknown_speed_sigma_m_s)

    def _predicted(self, estimate: Estimate, end_ns: int) -> Estimate:
        begin_ns = estimate.stamp_ns
        stamps, forces, rates = self.imu.around(begin_ns, end_ns)
        out = self._prediction.process(
            KalmanPredictionInputs(
                estimate.pose,
                estimate.velocity,
                estimate.biases,
                estimate.covariance,
                np.array([begin_ns, end_ns]),
                stamps,
                forces,
                rates,
                None if self.gravity_m_s2 is None else np.asarray(self.gravity_m_s2),
                self.lever_m,
            )
        )
        # Slip wanders about zero: a first-order Gauss-Markov process.
        keep = math.exp(-(end_ns - begin_ns) * 1e-9 / self.config.slip_time_s)
        P, since = out.covariance, estimate.since.copy()
        P[SLIP] *= keep
        P[:, SLIP] *= keep
        P[range(15, 18), range(15, 18)] += np.square(self.config.slip_sigma) * (1.0 - keep**2)
        since[:15] = out.transition @ since[:15]
        since[SLIP] *= keep
        return replace(
            estimate,
            stamp_ns=end_ns,
            pose=out.pose,
            velocity=out.velocity,
            slip=estimate.slip * keep,
            covariance=P,
            since=since,
        )

    def _begun_anew(self, event: Event, before: Clone) -> bool:
        """Whether a source may count from a new origin: it was silent, or no wheel could have come so far.

        Wheels count on while nobody listens.
        """
        since_s = (event.stamp_ns - before.stamp_ns) * 1e-9
        if event.source != "odometry":
            return since_s > self.config.odometry_gap_s
        assert event.measured is not None  # the caller has looked
        moved_m = float(np.linalg.norm(event.measured.matrix[:3, 3] - before.measured.matrix[:3, 3]))
        return moved_m > self.config.max_wheel_speed_m_s * since_s

    def _stepped(self, estimate: Estimate, event: Event, before: UncertainTransform) -> Estimate:
        """Correct by the increment since the clone; raises RefusedError where it contradicts the estimate."""
        now = event.measured
        assert now is not None  # the caller has looked
        mount = self._mount(event.child, event.stamp_ns) if event.child else np.eye(4)
        step = self._increments[event.source].process(
            OdometryIncrementInputs(before.matrix, now.matrix, mount, before.covariance, now.covariance)
        )
        expected, H = _motion(estimate, event.source)
        residual = pose_error(step.increment, expected)
        noise = step.covariance * event.scale
        if event.source != "odometry" and (now.covariance is None or before.covariance is None):
            noise = np.diag(np.square([self.config.unstated_sigma_m] * 3 + [self.config.unstated_sigma_rad] * 3))
        if event.source == "odometry":
            residual, H, noise = self._wheels(estimate, expected, H, residual, noise)
        if event.source not in self.config.correlated:
            return _corrected(estimate, self._correction, residual, H, noise)
        noise = noise * self._sharing(estimate, event)
        residual, H = self._relinearised(estimate, event.source, step.increment, residual, H, noise)
        return _corrected(estimate, self._correction, residual, H, noise)

    def _relinearised(
        self,
        estimate: Estimate,
        name: str,
        measured: FloatArray,
        residual: FloatArray,
        H: FloatArray,
        noise: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Residual and its derivatives about the estimate that the correction leads to (an iterated Kalman filter).

        Two sources of one motion must be linearised at one place: else what the correction by the first moves looks,
        to that by the second, like something learnt of the tilt.
        """
        out = self._correction.process(KalmanCorrectionInputs(residual, H, noise, estimate.covariance))
        expected, H = _motion(estimate.moved(out.correction), name)
        return pose_error(measured, expected) + H @ out.correction, H

    def _sharing(self, estimate: Estimate, event: Event) -> int:
        """Number of odometries that share errors with this one and may measure the same way.

        Covariance intersection with equal weights: the variances of k of them are multiplied by k. Those count that
        spoke so shortly before that their next increment can still be taken, whether or not it has arrived.
        """
        since_ns = event.stamp_ns - int(self.config.odometry_gap_s * 1e9)
        others = {*self.config.correlated} - {event.source}
        return 1 + sum(s in estimate.clones and estimate.clones[s].stamp_ns >= since_ns for s in others)

    def _wheels(
        self, estimate: Estimate, expected: FloatArray, H: FloatArray, residual: FloatArray, noise: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wheels count the way and the turn about the body's z, with the slip: four of the six."""
        d = expected[:3, 3]
        slipping = np.eye(3)
        slipping[:, 0] += estimate.slip
        H[:3] = slipping @ H[:3]
        H[:3, SLIP] = d[0] * np.eye(3)
        residual[:3] -= estimate.slip * d[0]
        rows = np.array([0, 1, 2, 5])
        floor = [self.config.wheel_floor_m**2] * 3 + [self.config.wheel_floor_rad**2]
        return residual[rows], H[rows], noise[np.ix_(rows, rows)] + np.diag(floor)

    def _fixed(self, estimate: Estimate, event: Event) -> tuple[Estimate, Verdict]:
        """Correct by an absolute pose, or by one in a frame whose place is learnt by its first pose."""
        measured = event.measured
        assert measured is not None  # the caller has looked
        if measured.covariance is None:
            return estimate, Verdict(False, ("fix_refused", "no_covariance"))
        mount = self._mount(event.child, event.stamp_ns) if event.child else np.eye(4)
        T = measured @ UncertainTransform(se3.inverse(mount), _EXACT)
        noise = np.asarray(T.covariance) * event.scale
        place = self._place(event.frame)
        if place is not None:
            R = np.kron(np.eye(2), place[:3, :3])
            z, noise, expected = place @ T.matrix, R @ noise @ R.T, estimate.pose
            H = np.eye(6, len(estimate.covariance))
        else:
            name = f"frame:{event.frame}"
            if name not in estimate.clones:
                return estimate.cloned(name, T), Verdict(False, ("fix_attached",))
            z = se3.inverse(estimate.clones[name].measured.matrix) @ T.matrix
            R = np.kron(np.eye(2), estimate.clones[name].measured.matrix[:3, :3])
            noise = R.T @ noise @ R
            expected, H = _motion(estimate, name)
        residual = pose_error(z, expected)
        try:
            if self.config.fix_weighting == "kalman":
                return _corrected(estimate, self._fix_correction, residual, H, noise), Verdict(True)
            return self._intersected(estimate, expected, z, residual, H, noise), Verdict(True)
        except RefusedError as error:
            return estimate, Verdict(False, ("fix_refused", *error.reasons))

    def _intersected(
        self,
        estimate: Estimate,
        expected: FloatArray,
        z: FloatArray,
        residual: FloatArray,
        H: FloatArray,
        N: FloatArray,
    ) -> Estimate:
        """Covariance intersection of what is measured; the other errors follow as far as they hang on it."""
        P = estimate.covariance
        PH = P @ H.T
        S = H @ PH
        S = 0.5 * (S + S.T)
        # The gate of a Kalman correction: what both say must agree. Its result is not used.
        self._fix_correction.process(KalmanCorrectionInputs(residual, np.eye(6), N, S))
        joined = self._weighting.process(PoseWeightingInputs(expected, S, z, N))
        if float(joined.weight) >= 1.0:
            return estimate
        G = np.linalg.solve(S + 1e-14 * np.eye(6), PH.T).T
        W = joined.covariance @ ((1.0 - float(joined.weight)) * np.linalg.inv(N + 1e-14 * np.eye(6)))
        covariance = P - G @ PH.T + G @ joined.covariance @ G.T
        K = G @ W
        return replace(
            estimate.moved(K @ residual),
            covariance=0.5 * (covariance + covariance.T),
            since=estimate.since - K @ (H @ estimate.since),
        )


def _motion(estimate: Estimate, name: str) -> tuple[FloatArray, FloatArray]:
    """``T_clone_base`` as estimated, and its errors (6, n) by those of the state."""
    clone = estimate.clones[name].pose
    Rt = clone[:3, :3].T
    d = estimate.pose[:3, 3] - clone[:3, 3]
    at = estimate.index(name).start
    H = np.zeros((6, len(estimate.covariance)))
    H[:3, :3] = H[3:, 3:6] = Rt
    H[:3, at : at + 3] = H[3:, at + 3 : at + 6] = -Rt
    H[:3, at + 3 : at + 6] = Rt @ se3.skew(d)
    return se3.transform(Rt @ estimate.pose[:3, :3], Rt @ d), H


def _corrected(
    estimate: Estimate, dfn: Dfn[Any, Any, Any], residual: FloatArray, H: FloatArray, noise: FloatArray
) -> Estimate:
    out = dfn.process(KalmanCorrectionInputs(residual, H, noise, estimate.covariance))
    return replace(
        estimate.moved(out.correction),
        covariance=out.covariance,
        since=estimate.since - out.gain @ (H @ estimate.since),
    )


def _doubted(estimate: Estimate, speed_sigma_m_s: float) -> Estimate:
    """With a velocity that is hardly known: what the IMU made of it was contradicted again and again."""
    P, since = estimate.covariance.copy(), estimate.since.copy()
    P[VELOCITY] = P[:, VELOCITY] = 0.0
    P[VELOCITY, VELOCITY] = speed_sigma_m_s**2 * np.eye(3)
    since[VELOCITY] = 0.0
    return replace(estimate, covariance=P, since=since, refused=0)


def first_estimate(
    stamp_ns: int, pose: UncertainTransform, velocity_sigma_m_s: float, bias_sigma: FloatArray, slip_sigma: FloatArray
) -> Estimate:
    """An estimate without clones; ``bias_sigma`` (6,) of gyro and accelerometer, ``slip_sigma`` (3,)."""
    P = np.zeros((CORE, CORE))
    P[POSE, POSE] = 0.0 if pose.covariance is None else pose.covariance
    diagonal = np.concatenate([np.full(3, velocity_sigma_m_s), bias_sigma, slip_sigma])
    P[6:, 6:] = np.diag(np.square(diagonal))
    zero = np.zeros(3)
    return Estimate(stamp_ns, pose.matrix, zero, np.zeros(6), zero, P, P[:, LINE].copy(), {})
