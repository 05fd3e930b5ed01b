# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Who moves the estimate: which sources speak, how far each is believed, and what the quality says of it."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimator import FIXES, Event, Verdict

#: Sources in the order in which they name the driver, with what the reasons call them.
_NAMES = {
    "visual_odometry": "vo", "lidar_odometry": "lidar", "fix": "fix", "absolute_fix": "absolute_fix",
    "odometry": "wheels", "imu": "imu",
}  # fmt: skip
ODOMETRIES = ("visual_odometry", "lidar_odometry")
#: Those that speak often: while they do, wheels and IMU are not published.
_STEADY = (*ODOMETRIES, "fix")
_FINE = (*_STEADY, "absolute_fix")
START, NOBODY = "source:start", "source:none"


class Drivers:
    """Times at which each source was last taken."""

    def __init__(self, config: PositionManagerConfig) -> None:
        self._config = config
        self._taken_ns: dict[str, int] = {}
        self._lost: set[str] = set()
        self._begin_ns = 0
        self._doubtful_ns = -1
        self._refused: dict[str, int] = {}
        #: Poses that were published DEGRADED.
        self.degraded = 0

    def begin(self, stamp_ns: int) -> None:
        """The line begins at a time."""
        self._begin_ns = stamp_ns

    def lose(self, source: str) -> None:
        """A source FAILED: the increment to its next pose is not its to give."""
        self._lost.add(source)

    def lost(self, source: str) -> bool:
        """Whether a source FAILED since it was last taken."""
        return source in self._lost

    def scale(self, sample: Sample) -> float:
        """What a sample's variances are multiplied by for what it is itself."""
        c, port = self._config, sample.port
        scale = {"visual_odometry": c.visual_scale, "lidar_odometry": c.lidar_scale}.get(port, 1.0)
        if port in FIXES:
            scale = c.fix_scale
        if sample.quality.status is Status.DEGRADED and port in _FINE:
            scale *= c.degraded_scale
            self._doubtful_ns = max(self._doubtful_ns, sample.stamp_ns)
        return scale

    def judge(self, event: Event, verdict: Verdict) -> None:
        """Remember what became of a measurement."""
        self._lost.discard(event.source)
        if verdict.taken:
            self._taken_ns[event.source] = max(event.stamp_ns, self._taken_ns.get(event.source, event.stamp_ns))
        elif any("_refused" in reason for reason in verdict.reasons):
            self.refuse(event.source)

    def refuse(self, source: str) -> None:
        """Count a measurement that was not taken."""
        self._refused[source] = self._refused.get(source, 0) + 1

    def speaks(self, event: Event, newest_ns: int) -> bool:
        """Whether an estimate is to be published: those of the fine sources; of the others when they are silent."""
        if event.source in _FINE:
            return True
        silent = not any(self._heard(s, event.stamp_ns) for s in _STEADY)
        return silent and event.stamp_ns == newest_ns

    def quality(self, stamp_ns: int, T: UncertainTransform, reasons: tuple[str, ...]) -> Quality:
        """Of the pose at a time."""
        driver = next((s for s in _NAMES if self._recent(s, stamp_ns)), None)
        if driver is None:
            name = START if stamp_ns - self._begin_ns <= self._config.visual_timeout_s * 1e9 else NOBODY
        else:
            name = f"source:{_NAMES[driver]}"
        doubtful = stamp_ns - self._doubtful_ns <= self._config.visual_timeout_s * 1e9 and self._doubtful_ns >= 0
        fine = name == START or (driver in _FINE and not doubtful)
        self.degraded += not fine
        sigma = np.sqrt(np.diagonal(np.asarray(T.covariance)))
        seen_ns = max((self._taken_ns.get(s, self._begin_ns) for s in ODOMETRIES), default=self._begin_ns)
        metrics = {
            "sigma_position_m": float(np.linalg.norm(sigma[:3])),
            "sigma_rotation_rad": float(np.linalg.norm(sigma[3:])),
            "visual_age_s": max(stamp_ns - seen_ns, 0) * 1e-9,
            **{f"refused_{_NAMES.get(s, s)}": float(n) for s, n in sorted(self._refused.items())},
        }
        said = (name, *reasons, *(("odometry_degraded",) if doubtful else ()))
        return Quality(Status.OK if fine else Status.DEGRADED, said, CovarianceKind.FORMAL, metrics)

    def _recent(self, source: str, stamp_ns: int) -> bool:
        taken = self._taken_ns.get(source)
        return taken is not None and abs(stamp_ns - taken) <= self._config.visual_timeout_s * 1e9

    def _heard(self, source: str, stamp_ns: int) -> bool:
        """Whether a source was taken, or the line began, within the timeout."""
        return stamp_ns - self._taken_ns.get(source, self._begin_ns) <= self._config.visual_timeout_s * 1e9
