# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Monitor of the sources: their last use, the weight of their measurements, and the quality of the pose."""

from __future__ import annotations

from collections import deque

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import TransformWithCovariance
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.measurement import FIXES, Measurement, MeasurementResult

#: Sources in order of precedence, with their names in the reasons and metrics of the quality.
_NAMES = {
    "visual_odometry": "vo",
    "lidar_odometry": "lidar",
    "fix": "fix",
    "absolute_fix": "absolute_fix",
    "odometry": "wheels",
    "imu": "imu",
}
_ODOMETRIES = ("visual_odometry", "lidar_odometry")
#: Frequent accurate sources: while one of them is used, poses from wheels and IMU are not published.
_FREQUENT = (*_ODOMETRIES, "fix")
_ACCURATE = (*_FREQUENT, "absolute_fix")
#: Minimum interval of wheel poses, nanoseconds; poses that follow sooner are skipped.
_WHEEL_PERIOD_NS = 45_000_000
#: Factor on the variances of a DEGRADED measurement.
_DEGRADED_SCALE = 25.0
#: The fraction of refused measurements is computed over this number of the newest measurements of a source,
#: from this least number on; above this fraction a pose is DEGRADED, since the source contradicts the
#: others.
_WINDOW, _LEAST_RESULTS, _MAX_REFUSED_FRACTION = 20, 8, 0.5


class SourceMonitor:
    """Records use, failures and refusals of each source."""

    def __init__(self, config: PositionManagerConfig) -> None:
        odometry = config.odometry
        self._scales = {"visual_odometry": odometry.visual_scale, "lidar_odometry": odometry.lidar_scale}
        self._scales |= dict.fromkeys(FIXES, config.fixes.scale)
        self._timeout_ns = odometry.timeout_s * 1e9
        self._start_ns = 0
        self._wheels_ns = -(1 << 62)
        self._used_ns: dict[str, int] = {}
        self._failed: set[str] = set()
        self._refusals: dict[str, int] = {}
        #: For each source: True for each of the newest measurements that was refused.
        self._results: dict[str, deque[bool]] = {}
        #: Frame of each source whose sensor has no known pose on the robot at present.
        self._unplaced: dict[str, str] = {}
        self._last_degraded_ns: int | None = None
        #: Number of poses published as DEGRADED.
        self.degraded_poses = 0

    def start(self, stamp_ns: int) -> None:
        """Set the start of the timeline."""
        self._start_ns = stamp_ns

    def is_too_frequent(self, sample: Sample) -> bool:
        """Return whether a wheel pose follows the last used one too soon; if not, it becomes the last used
        one.
        """
        if 0 <= sample.stamp_ns - self._wheels_ns < _WHEEL_PERIOD_NS:
            return True
        self._wheels_ns = max(self._wheels_ns, sample.stamp_ns)
        return False

    def mark_failed(self, source: str) -> None:
        """Record that a source FAILED: no increment ends at its next pose."""
        self._failed.add(source)

    def measurement(self, sample: Sample, base: str) -> Measurement:
        """Return the measurement of a pose sample with the scale of its variances."""
        value: TransformWithCovariance = sample.value
        scale = self._scales.get(sample.port, 1.0)
        if sample.quality.status is Status.DEGRADED and sample.port in _ACCURATE:
            scale *= _DEGRADED_SCALE
            self._last_degraded_ns = max(self._last_degraded_ns or 0, sample.stamp_ns)
        return Measurement(
            sample.stamp_ns,
            sample.port,
            value.transform,
            frame=value.parent_frame,
            child=base if sample.port == "odometry" else value.child_frame,
            scale=scale,
            restart=sample.port in self._failed,
        )

    def mark_unplaced(self, source: str, frame: str) -> None:
        """Record that the frame of a source has no place on the robot: its measurements are not used."""
        self._unplaced[source] = frame
        self._failed.add(source)
        self.count_refusal(source)

    def record(self, measurement: Measurement, result: MeasurementResult) -> None:
        """Record the result of a measurement."""
        source, stamp_ns = measurement.source, measurement.stamp_ns
        self._failed.discard(source)
        self._unplaced.pop(source, None)
        if result.used or result.is_refused:
            self._results.setdefault(source, deque(maxlen=_WINDOW)).append(result.is_refused)
        if result.used:
            self._used_ns[source] = max(stamp_ns, self._used_ns.get(source, stamp_ns))
        elif result.is_refused:
            self.count_refusal(source)

    def count_refusal(self, source: str) -> None:
        """Count a measurement that was not used."""
        self._refusals[source] = self._refusals.get(source, 0) + 1

    def is_published(self, measurement: Measurement, newest_ns: int) -> bool:
        """Return whether a measurement leads to a published pose.

        This is always so for accurate sources, and for the others while the frequent ones are silent.
        """
        if measurement.source in _ACCURATE:
            return True
        is_silent = all(
            measurement.stamp_ns - self._used_ns.get(s, self._start_ns) > self._timeout_ns for s in _FREQUENT
        )
        return is_silent and measurement.stamp_ns == newest_ns

    def quality(self, stamp_ns: int, T: UncertainTransform, reasons: tuple[str, ...]) -> Quality:
        """Return the quality of a pose and count it if it is DEGRADED."""
        source = next((s for s in _NAMES if self._is_recent(s, stamp_ns)), None)
        at_start = source is None and stamp_ns - self._start_ns <= self._timeout_ns
        name = _NAMES[source] if source else "start" if at_start else "none"
        last_ns = self._last_degraded_ns
        input_degraded = last_ns is not None and stamp_ns - last_ns <= self._timeout_ns
        conflicts = (*self._refused_fractions(), *self._unplaced_sources())
        is_ok = at_start or (source in _ACCURATE and not input_degraded and not conflicts)
        self.degraded_poses += not is_ok
        sigma = np.sqrt(np.diagonal(np.asarray(T.covariance)))
        used_ns = max(self._used_ns.get(s, self._start_ns) for s in _ODOMETRIES)
        metrics = {
            "sigma_position_m": float(np.linalg.norm(sigma[:3])),
            "sigma_rotation_rad": float(np.linalg.norm(sigma[3:])),
            "visual_age_s": max(stamp_ns - used_ns, 0) * 1e-9,
            **{f"refused_{_NAMES.get(s, s)}": float(n) for s, n in sorted(self._refusals.items())},
        }
        reasons = (
            f"source:{name}",
            *reasons,
            *(("odometry_degraded",) if input_degraded else ()),
            *conflicts,
        )
        return Quality(Status.OK if is_ok else Status.DEGRADED, reasons, CovarianceKind.FORMAL, metrics)

    def _refused_fractions(self) -> list[str]:
        """Return a reason for each source most of whose newest measurements were refused."""
        return [
            f"refused:{_NAMES.get(source, source)}_{sum(results) / len(results):.2f}"
            for source, results in self._results.items()
            if len(results) >= _LEAST_RESULTS and sum(results) > _MAX_REFUSED_FRACTION * len(results)
        ]

    def _unplaced_sources(self) -> list[str]:
        """Return a reason for each source whose sensor has no place on the robot."""
        return [f"unplaced:{_NAMES.get(s, s)}_{frame}" for s, frame in self._unplaced.items()]

    def _is_recent(self, source: str, stamp_ns: int) -> bool:
        used_ns = self._used_ns.get(source)
        return used_ns is not None and abs(stamp_ns - used_ns) <= self._timeout_ns
