# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a frame over time, and the tree of frames with static and moving edges, as in EnviRe."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable
from dataclasses import dataclass, field

from cdff_common.errors import ConflictError, ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry.uncertain_transform import UncertainTransform, interpolate

#: Distance in time from a track within which its nearest pose is used for a frame: one fifth of a second.
EXTRAPOLATION_LIMIT_NS = 200_000_000
_FRAME = re.compile(r"[a-z0-9_]+(/[a-z0-9_]+)*\Z")


def checked_frame(frame: str, name: str = "frame") -> str:
    """Return a valid frame id; raises InputError for others."""
    if len(frame) > 128 or not _FRAME.match(frame):
        raise InputError(f"{name}={frame!r}: expected [a-z0-9_]+(/[a-z0-9_]+)*, e.g. site or mana/base")
    return frame


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
        first_retained = max(bisect_left(self.stamps_ns, stamp_ns) - 1, 0)
        next_rows = [bisect_right(self.stamps_ns, t) for t in keep_ns] if first_retained else []
        retained = {i for k in next_rows for i in (k - 1, k) if 0 <= i < first_retained}
        if len(retained) == first_retained:
            return
        evicted = False
        for i, stamp in enumerate(self.stamps_ns[: first_retained + 1]):
            if i == first_retained or i in retained:
                if evicted and retained and i > min(retained):
                    self.gap_ends.add(stamp)
                evicted = False
            else:
                del self.poses[stamp]
                evicted = True
        self.stamps_ns[:first_retained] = [self.stamps_ns[i] for i in sorted(retained)]
        self.gap_ends = {s for s in self.gap_ends if s in self.poses and s != self.stamps_ns[0]}

    def gap_ns(self, stamp_ns: int) -> int:
        """Return the largest distance in time from ``stamp_ns`` to the poses next to it, 0 at a pose.

        Of several tracks of one frame, the one with the smallest gap is the best at this time.
        """
        i = bisect_left(self.stamps_ns, stamp_ns)
        if i < len(self.stamps_ns) and self.stamps_ns[i] == stamp_ns:
            return 0
        return max((abs(stamp_ns - s) for s in self.stamps_ns[max(i - 1, 0) : i + 1]), default=0)

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


class FrameGraph:
    """Tree of frames; every frame except the root has one parent.

    Lookups compose the edges of the chain through the common ancestor. The result has a covariance if every
    edge has one.
    """

    def __init__(self) -> None:
        self._parent: dict[str, str] = {}
        self._edge: dict[str, UncertainTransform | PoseTrack] = {}
        self._roots: set[str] = set()

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames, sorted."""
        return tuple(sorted({*self._parent, *self._parent.values(), *self._roots}))

    def parent_of(self, child: str) -> str | None:
        """Return the parent of a frame, or None for a root."""
        return self._parent.get(child)

    def set_static(self, parent: str, child: str, T_parent_child: UncertainTransform) -> None:
        """Set or replace the fixed edge from ``parent`` to ``child``."""
        self._attach(parent, child, T_parent_child)

    def track(self, parent: str, child: str, extrapolation_limit_ns: int = 0) -> PoseTrack:
        """Return the moving edge from ``parent`` to ``child``; create an empty one if there is none."""
        edge = self._edge.get(child)
        if isinstance(edge, PoseTrack) and self._parent[child] == parent:
            return edge
        track = PoseTrack(extrapolation_limit_ns)
        self._attach(parent, child, track)
        return track

    def lookup(self, parent: str, child: str, stamp_ns: int) -> UncertainTransform:
        """Return ``T_parent_child`` at ``stamp_ns``.

        Raises
        ------
        FrameNotFoundError
            If a frame is unknown or no chain connects the two.
        ExtrapolationError
            If a moving edge of the chain does not cover the time.
        """
        chain_of_parent, chain_of_child = self._chain(parent), self._chain(child)
        common = next((f for f in chain_of_child if f in set(chain_of_parent)), None)
        if common is None:
            raise FrameNotFoundError(
                f"no chain connects {parent} and {child}: their roots are {chain_of_parent[-1]} and "
                f"{chain_of_child[-1]}"
            )
        T_common_parent = self._compose(common, chain_of_parent, stamp_ns)
        T_common_child = self._compose(common, chain_of_child, stamp_ns)
        return T_common_parent.inverse() @ T_common_child

    def _attach(self, parent: str, child: str, edge: UncertainTransform | PoseTrack) -> None:
        """Add an edge; raises ConflictError for a second parent, InputError for a loop."""
        checked_frame(parent, "parent")
        checked_frame(child, "child")
        current_parent = self._parent.get(child)
        if current_parent is not None and current_parent != parent:
            raise ConflictError(
                f"frame {child} has the parent {current_parent}; it cannot also have the parent {parent}"
            )
        if child in self._chain_or_empty(parent):
            raise InputError(f"{parent} is a descendant of {child}: the edge would close a loop")
        self._roots.add(parent)
        self._roots.discard(child)
        self._parent[child] = parent
        self._edge[child] = edge

    def _chain(self, frame: str) -> list[str]:
        if frame not in self._parent and frame not in self._roots and frame not in self._parent.values():
            raise FrameNotFoundError(
                f"frame {frame!r} is unknown; known frames: {', '.join(self.frames) or 'none'}"
            )
        return self._chain_or_empty(frame)

    def _chain_or_empty(self, frame: str) -> list[str]:
        chain = [frame]
        while chain[-1] in self._parent:
            chain.append(self._parent[chain[-1]])
        return chain

    def _compose(self, ancestor: str, chain_up: list[str], stamp_ns: int) -> UncertainTransform:
        """Return ``T_ancestor_frame`` of the first frame of a chain."""
        T = UncertainTransform.identity()
        for frame in reversed(chain_up[: chain_up.index(ancestor)]):
            edge = self._edge[frame]
            if isinstance(edge, PoseTrack):
                edge = edge.at(stamp_ns, f"{self._parent[frame]} to {frame}")
            T = T @ edge
        return T
