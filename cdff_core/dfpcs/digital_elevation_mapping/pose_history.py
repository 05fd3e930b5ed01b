# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The poses of the last seconds, and what of a capture they cover."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import PoseTrack, UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.types import PoseTrajectory

_CERTAINTY = [CovarianceKind.NONE, CovarianceKind.FORMAL, CovarianceKind.CALIBRATED]


class PoseHistory:
    """Poses ``T_map_body`` of one pair of frames, kept for a while.

    Parameters
    ----------
    keep_s : float
        How long a pose is kept, seconds of mission time.

    Attributes
    ----------
    map_frame, body_frame : str
        Parent and child of the poses; empty until the first.
    """

    def __init__(self, keep_s: float) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._track = PoseTrack()
        self._samples: dict[int, Sample] = {}
        self.map_frame = ""
        self.body_frame = ""

    def insert(self, sample: Sample) -> bool:
        """Take a pose; tell whether its frames differ from the earlier ones, which are then forgotten."""
        pose = sample.value
        changed = (pose.parent_frame, pose.child_frame) != (self.map_frame, self.body_frame)
        renewed = changed and bool(self.map_frame)
        if changed:
            self._track, self._samples = PoseTrack(), {}
            self.map_frame, self.body_frame = pose.parent_frame, pose.child_frame
        self._track.insert(sample.stamp_ns, pose.transform)
        self._samples[sample.stamp_ns] = sample
        self._track.forget_before(sample.stamp_ns - self._keep_ns)
        first = self._track.stamps_ns[0]
        for old in [s for s in self._samples if s < first]:
            del self._samples[old]
        return renewed

    @property
    def stamps_ns(self) -> list[int]:
        """Stamps of the poses kept, rising."""
        return self._track.stamps_ns

    @property
    def only_pose_ns(self) -> int | None:
        """Stamp of the one pose there is; None where there are none or more."""
        return self._track.stamps_ns[0] if len(self._track.stamps_ns) == 1 else None

    def reaches(self, stamp_ns: int) -> bool:
        """Whether there is a pose at or after a time."""
        return bool(self.stamps_ns) and self.stamps_ns[-1] >= stamp_ns

    def begins_after(self, stamp_ns: int) -> bool:
        """Whether the first pose kept is later than a time."""
        return bool(self.stamps_ns) and self.stamps_ns[0] > stamp_ns

    def at(self, stamp_ns: int) -> UncertainTransform:
        """Interpolated pose; raises ExtrapolationError outside the history."""
        return self._track.at(stamp_ns, f"{self.map_frame} to {self.body_frame}")

    def around(self, t0_ns: int, t1_ns: int) -> tuple[PoseTrajectory, list[Sample]]:
        """The poses that enclose a capture, and the samples they came with."""
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        first = max(int(np.searchsorted(stamps, t0_ns, side="right")) - 1, 0)
        last = min(int(np.searchsorted(stamps, t1_ns, side="left")) + 1, len(stamps))
        chosen = [int(s) for s in stamps[first:last]]
        poses = [self._track.poses[s] for s in chosen]
        covariances = [p.covariance for p in poses if p.covariance is not None]
        trajectory = PoseTrajectory.from_arrays(
            chosen, [p.matrix for p in poses], np.array(covariances) if len(covariances) == len(poses) else None,
            parent=self.map_frame, child=self.body_frame,
        )  # fmt: skip
        return trajectory, [self._samples[s] for s in chosen]


def covariance_kind_of(poses: list[Sample]) -> CovarianceKind:
    """The least certain kind among poses with covariance; a covariance of unstated origin counts as formal."""
    if not poses or any(p.value.transform.covariance is None for p in poses):
        return CovarianceKind.NONE
    return min((max(p.quality.covariance_kind, CovarianceKind.FORMAL, key=_CERTAINTY.index) for p in poses),
               key=_CERTAINTY.index)  # fmt: skip


def degraded(poses: list[Sample]) -> bool:
    """Whether any of the poses is DEGRADED."""
    return any(p.quality.status is Status.DEGRADED for p in poses)
