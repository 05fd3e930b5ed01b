# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of one frame in another over time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable
from dataclasses import dataclass, field

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry.uncertain_transform import UncertainTransform, interpolate


@dataclass(slots=True)
class PoseTrack:
    """Poses of one child frame in one parent frame, sorted by time and interpolated; no extrapolation of the
    motion.

    Attributes
    ----------
    extrapolation_limit_ns : int
        Distance outside the covered time within which the nearest pose is returned, nanoseconds.
    gap_ends : set of int
        Stamps of poses that follow evicted ones; nothing is interpolated between such a pose and its
        predecessor.

    See Also
    --------
    OdometryBuffer : Bounded memory and extrapolation at constant velocity.
    """

    extrapolation_limit_ns: int = 0
    stamps_ns: list[int] = field(default_factory=list)
    poses: dict[int, UncertainTransform] = field(default_factory=dict)
    gap_ends: set[int] = field(default_factory=set)

    def insert(self, stamp_ns: int, pose: UncertainTransform) -> None:
        """Add a pose, or replace the one at the same stamp."""
        if stamp_ns not in self.poses:
            insort(self.stamps_ns, stamp_ns)
        self.poses[stamp_ns] = pose

    def evict_before(self, stamp_ns: int, keep_ns: Iterable[int] = ()) -> None:
        """Remove poses older than ``stamp_ns``, except the last one and the neighbours of ``keep_ns``."""
        cut = max(bisect_left(self.stamps_ns, stamp_ns) - 1, 0)
        next_rows = [bisect_right(self.stamps_ns, t) for t in keep_ns] if cut else []
        retained = {i for k in next_rows for i in (k - 1, k) if 0 <= i < cut}
        if len(retained) == cut:
            return
        evicted = False
        for i, stamp in enumerate(self.stamps_ns[: cut + 1]):
            if i == cut or i in retained:
                if evicted and retained and i > min(retained):
                    self.gap_ends.add(stamp)
                evicted = False
            else:
                del self.poses[stamp]
                evicted = True
        self.stamps_ns[:cut] = [self.stamps_ns[i] for i in sorted(retained)]
        self.gap_ends = {s for s in self.gap_ends if s in self.poses and s != self.stamps_ns[0]}

    def at(self, stamp_ns: int, name: str = "pose") -> UncertainTransform:
        """Return the pose at ``stamp_ns``; ``name`` names the pose in error messages.

        Raises
        ------
        ExtrapolationError
            If the track is empty, the stamp is in a gap, or outside the covered time by more than the limit.
        """
        if not self.stamps_ns:
            raise ExtrapolationError(f"{name}: no pose is known yet")
        i = bisect_left(self.stamps_ns, stamp_ns)
        if i < len(self.stamps_ns) and self.stamps_ns[i] == stamp_ns:
            return self.poses[stamp_ns]
        first, last = self.stamps_ns[0], self.stamps_ns[-1]
        if 0 < i < len(self.stamps_ns):
            a, b = self.stamps_ns[i - 1], self.stamps_ns[i]
            if b in self.gap_ends:
                raise ExtrapolationError(f"{name} at t={stamp_ns}: poses from {a} to {b} were evicted")
            return interpolate(self.poses[a], self.poses[b], (stamp_ns - a) / (b - a))
        nearest = first if i == 0 else last
        if abs(stamp_ns - nearest) <= self.extrapolation_limit_ns:
            return self.poses[nearest]
        raise ExtrapolationError(
            f"{name} at t={stamp_ns}: known from {first} to {last}, "
            f"{abs(stamp_ns - nearest) / 1e9:.3f} s outside; request a time inside that interval"
        )
