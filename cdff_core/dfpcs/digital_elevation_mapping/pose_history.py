# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of the last seconds, and their coverage of captures."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import PoseTrack, UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import CovarianceKind, Status

#: Kinds of covariance, least certain first.
_CERTAINTY = [CovarianceKind.NONE, CovarianceKind.FORMAL, CovarianceKind.CALIBRATED]

#: Age at which poses are removed, nanoseconds.
_MAX_AGE_NS = 30_000_000_000


class PoseHistory:
    """Poses ``T_map_body`` of one pair of frames, whose names are empty until the first pose."""

    def __init__(self) -> None:
        self._track = PoseTrack()
        self._samples: dict[int, Sample] = {}
        self.map_frame = ""
        self.body_frame = ""

    def insert(self, sample: Sample) -> bool:
        """Insert a pose; return True if its frames are new, which removes the earlier poses."""
        pose = sample.value
        frames = pose.parent_frame, pose.child_frame
        is_restarted = self.map_frame != "" and frames != (self.map_frame, self.body_frame)
        if is_restarted:
            self._track, self._samples = PoseTrack(), {}
        self.map_frame, self.body_frame = frames
        self._track.insert(sample.stamp_ns, pose.transform)
        self._samples[sample.stamp_ns] = sample
        self._track.evict_before(sample.stamp_ns - _MAX_AGE_NS)
        oldest_ns = self._track.stamps_ns[0]
        for old in [s for s in self._samples if s < oldest_ns]:
            del self._samples[old]
        return is_restarted

    @property
    def stamps_ns(self) -> list[int]:
        """Stamps of the poses, ascending."""
        return self._track.stamps_ns

    @property
    def only_pose_ns(self) -> int | None:
        """Stamp of the only pose; None without poses or with several."""
        return self._track.stamps_ns[0] if len(self._track.stamps_ns) == 1 else None

    def reaches(self, stamp_ns: int) -> bool:
        """True if there is a pose at or after a time."""
        return bool(self.stamps_ns) and self.stamps_ns[-1] >= stamp_ns

    def starts_after(self, stamp_ns: int) -> bool:
        """True if the first pose is later than a time."""
        return bool(self.stamps_ns) and self.stamps_ns[0] > stamp_ns

    def at(self, stamp_ns: int) -> UncertainTransform:
        """Return the interpolated pose; raises ExtrapolationError outside the history."""
        return self._track.at(stamp_ns, f"{self.map_frame} to {self.body_frame}")

    def around(self, t0_ns: int, t1_ns: int) -> list[Sample]:
        """Return the pose samples that enclose a capture."""
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        first = max(int(np.searchsorted(stamps, t0_ns, side="right")) - 1, 0)
        last = min(int(np.searchsorted(stamps, t1_ns, side="left")) + 1, len(stamps))
        return [self._samples[int(s)] for s in stamps[first:last]]


def covariance_kind_of(poses: list[Sample]) -> CovarianceKind:
    """Return the least certain kind of the poses; a covariance of unstated origin counts as formal."""
    if not poses or any(p.value.transform.covariance is None for p in poses):
        return CovarianceKind.NONE
    return min(
        (max(p.quality.covariance_kind, CovarianceKind.FORMAL, key=_CERTAINTY.index) for p in poses),
        key=_CERTAINTY.index,
    )


def any_degraded(poses: list[Sample]) -> bool:
    """True if any of the poses is DEGRADED."""
    return any(p.quality.status is Status.DEGRADED for p in poses)
