# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the visual odometry remembers: the last view, the key frame, the path, the disparity offset."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import FramePair, PoseTrajectory
from cdff_core.dfpcs.visual_odometry_sparse._linked import LinkedPose
from cdff_core.imaging.frames import check_straight
from cdff_core.imaging.grey import grey_image
from cdff_core.imaging.rectified_camera import RectifiedCamera

FloatArray = NDArray[np.float64]
#: Translation and rotation of ``T_left1_left2`` between two times as other sensors felt it; None where not.
Increment = Callable[[int, int], tuple[FloatArray | None, FloatArray | None]]
#: What is unseen across a gap, one sigma: where nothing was felt a tenth of a metre and the way expected; with wheels
#: so much of the way they tell of (slip), with a gyro so much for each second (its bias).
_BLIND_M, _BLIND_RAD, _BLIND_RAD_S = 0.1, 0.05, 0.1
_SLIP_SHARE, _FELT_M, _FELT_RAD, _GYRO_RAD_S = 0.2, 0.02, 0.01, 0.003
#: Camera matrices and baselines that agree to so much are one camera's: a thousandth of a pixel and less.
_SAME_CAMERA = 1e-6


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
        """Take a pair apart; raises InputError on unknown pixels, a lens with distortion, or no possible camera."""
        check_straight(pair.left, pair.right)
        RectifiedCamera.from_matrix(pair.left.camera_matrix, pair.baseline)
        return cls(
            pair=pair,
            stamp_ns=stamp_ns,
            sample_id=sample_id,
            left=grey_image(pair.left),
            right=grey_image(pair.right),
            camera_matrix=np.array(pair.left.camera_matrix, np.float64),
            baseline=np.array([pair.baseline]),
        )

    def is_of_camera(self, other: View) -> bool:
        """Whether another pair was taken alike: image size, camera matrix and baseline."""
        return self.left.shape == other.left.shape and all(
            np.allclose(a, b, rtol=_SAME_CAMERA, atol=0.0)
            for a, b in ((self.camera_matrix, other.camera_matrix), (self.baseline, other.baseline))
        )


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """The pair that is tracked against: its points in pixels and in space, and its pose ``T_vo_keyframe``.

    ``slopes`` (n, 2) are the derivatives of the disparity by column and row: how the surface lies around a point.
    """

    view: View
    pose: LinkedPose
    features: FloatArray
    disparities: FloatArray
    slopes: FloatArray
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
    """Poses ``T_vo_left`` in order of time, and the motion that they and other sensors lead one to expect."""

    length: int
    felt: Increment
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
        """``T_vo_left`` (4, 4) expected at a time: as felt since, else at constant velocity, for a second."""
        last_ns, last = self._last()
        return last.matrix @ self._expected(self.felt(last_ns, stamp_ns), 1e-9 * (stamp_ns - last_ns))

    def is_felt(self, stamp_ns: int) -> bool:
        """Whether anything but the images tells of the motion up to a time."""
        last_ns, _ = self._last()
        return any(part is not None for part in self.felt(last_ns, stamp_ns))

    def across_gap(self, stamp_ns: int) -> UncertainTransform:
        """The expected pose with a covariance for not having seen the way: as far off as the way itself is long."""
        last_ns, last = self._last()
        elapsed_s = 1e-9 * (stamp_ns - last_ns)
        translation, rotation = self.felt(last_ns, stamp_ns)
        off_m = _BLIND_M + float(np.linalg.norm(self._twist[:3])) * elapsed_s
        off_rad = min(_BLIND_RAD + (_BLIND_RAD_S + float(np.linalg.norm(self._twist[3:]))) * elapsed_s, np.pi)
        if translation is not None:
            off_m = _FELT_M + _SLIP_SHARE * float(np.linalg.norm(translation))
        if rotation is not None:
            off_rad = min(_FELT_RAD + _GYRO_RAD_S * elapsed_s, np.pi)
        blind = np.diag([off_m**2] * 3 + [off_rad**2] * 3)
        before = np.zeros((6, 6)) if last.covariance is None else last.covariance
        expected = self._expected((translation, rotation), elapsed_s)
        return UncertainTransform(last.matrix @ expected, before + blind)

    def _expected(self, felt: tuple[FloatArray | None, FloatArray | None], elapsed_s: float) -> FloatArray:
        """``T_left1_left2`` after a time."""
        translation, rotation = felt
        T = se3.exp_se3(self._twist * min(elapsed_s, 1.0))
        return se3.transform(
            T[:3, :3] if rotation is None else rotation, T[:3, 3] if translation is None else translation
        )

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
