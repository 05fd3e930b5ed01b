# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the visual odometry remembers: the last view, the key frame, the path, the disparity offset."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import FramePair, PoseTrajectory
from cdff_core.imaging.grey import grey_image

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One stereo pair, as the DFNs take it, with what was noticed about it."""

    pair: FramePair
    stamp_ns: int
    sample_id: str
    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    camera_matrix: FloatArray
    baseline: FloatArray

    @classmethod
    def of(cls, pair: FramePair, stamp_ns: int, sample_id: str) -> View:
        """Take a pair apart; raises InputError on a pixel format that is not known."""
        return cls(
            pair=pair,
            stamp_ns=stamp_ns,
            sample_id=sample_id,
            left=grey_image(pair.left),
            right=grey_image(pair.right),
            camera_matrix=np.array(pair.left.camera_matrix, np.float64),
            baseline=np.array([pair.baseline]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """The pair that is tracked against: its points in pixels and in space, and its pose ``T_vo_keyframe``."""

    view: View
    pose: UncertainTransform
    features: FloatArray
    disparities: FloatArray
    basis: FloatArray
    points: FloatArray
    sharpness: float


@dataclass(slots=True)
class Calibration:
    """What is known of the disparity field that the rows leave open (see RectificationRefinement): a Gaussian.

    The motion estimator narrows it; its answer is taken over only when the key frame changes, since estimates against
    one key frame share its noise.
    """

    sigma_walk_px: float
    mean_px: FloatArray = field(default_factory=lambda: np.zeros(2))
    covariance_px2: FloatArray | None = None
    _latest: tuple[FloatArray, FloatArray] | None = field(default=None, init=False)

    def note(self, mean_px: FloatArray, covariance_px2: FloatArray) -> None:
        """Keep the estimator's answer until the key frame changes."""
        self._latest = (mean_px, covariance_px2)

    def hand_over(self, open_covariance: FloatArray) -> None:
        """Take the last answer as what is known, a little less surely; begin with what the rows leave open."""
        if self.covariance_px2 is None:
            self.covariance_px2 = open_covariance
        if self._latest is not None:
            self.mean_px, self.covariance_px2 = self._latest[0], self._latest[1] + self.sigma_walk_px**2 * np.eye(2)
            self._latest = None


@dataclass(slots=True)
class Path:
    """Poses ``T_vo_left`` in order of time, and the motion that the measured ones lead one to expect."""

    length: int
    stamps_ns: deque[int] = field(init=False)
    poses: deque[UncertainTransform] = field(init=False)
    _measured: tuple[int, UncertainTransform] | None = field(default=None, init=False)
    _twist: FloatArray = field(default_factory=lambda: np.zeros(6), init=False)

    def __post_init__(self) -> None:
        self.stamps_ns, self.poses = deque(maxlen=self.length), deque(maxlen=self.length)

    def __bool__(self) -> bool:
        return bool(self.poses)

    def measured(self, stamp_ns: int, pose: UncertainTransform, *, after_gap: bool = False) -> None:
        """Add a measured pose; the jump across a gap says nothing of the velocity."""
        if self._measured is not None and not after_gap:
            before_ns, before = self._measured
            self._twist = se3.log_se3(se3.inverse(before.matrix) @ pose.matrix) / (1e-9 * (stamp_ns - before_ns))
        self._measured = (stamp_ns, pose)
        self._append(stamp_ns, pose)

    def repeated(self, stamp_ns: int) -> UncertainTransform:
        """Add the last pose again, as uncertain as the motion that was expected since."""
        pose = UncertainTransform(self.poses[-1].matrix, self.across_gap(stamp_ns).covariance)
        self._append(stamp_ns, pose)
        return pose

    def _append(self, stamp_ns: int, pose: UncertainTransform) -> None:
        self.stamps_ns.append(stamp_ns)
        self.poses.append(pose)

    def _last(self) -> tuple[int, UncertainTransform]:
        if self._measured is None:
            raise RefusedError("nothing measured yet", ["no_pose"])
        return self._measured

    def predict(self, stamp_ns: int) -> FloatArray:
        """``T_vo_left`` (4, 4) expected at a time, at constant velocity for at most a second."""
        last_ns, last = self._last()
        return last.matrix @ se3.exp_se3(self._twist * min(1e-9 * (stamp_ns - last_ns), 1.0))

    def across_gap(self, stamp_ns: int) -> UncertainTransform:
        """The expected pose with a covariance for not having seen the way: as far off as the way itself is long."""
        last_ns, last = self._last()
        elapsed_s = 1e-9 * (stamp_ns - last_ns)
        moved_m = 0.1 + float(np.linalg.norm(self._twist[:3])) * elapsed_s
        turned_rad = min(0.05 + (0.1 + float(np.linalg.norm(self._twist[3:]))) * elapsed_s, np.pi)
        blind = np.diag([moved_m**2] * 3 + [turned_rad**2] * 3)
        before = np.zeros((6, 6)) if last.covariance is None else last.covariance
        return UncertainTransform(self.predict(stamp_ns), before + blind)

    def trajectory(self, parent: str, child: str) -> PoseTrajectory | None:
        """All poses; None where there is none yet."""
        if not self.poses:
            return None
        unknown = np.full((6, 6), np.nan)
        covariances = [unknown if p.covariance is None else p.covariance for p in self.poses]
        return PoseTrajectory.from_arrays(
            np.array(self.stamps_ns), np.stack([p.matrix for p in self.poses]), np.stack(covariances),
            parent=parent, child=child,
        )  # fmt: skip


def required(count: int, least: int, what: str) -> None:
    """Raise RefusedError ``what:count<least`` where there are too few."""
    if count < least:
        raise RefusedError(f"{what}: {count}, expected at least {least}", [f"{what}:{count}<{least}"])
