# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tree of frames, as EnviRe has it: edges fixed or moving in time, looked up between any two frames."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable
from dataclasses import dataclass, field

from cdff_common.errors import ConflictError, ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry.uncertain import UncertainTransform, interpolate

_FRAME = re.compile(r"[a-z0-9_]+(/[a-z0-9_]+)*\Z")


def checked_frame(frame: str, name: str = "frame") -> str:
    """Return a frame id that follows contract §6, else raise InputError."""
    if len(frame) > 128 or not _FRAME.match(frame):
        raise InputError(f"{name}={frame!r}: expected [a-z0-9_]+(/[a-z0-9_]+)*, as in site or mana/base")
    return frame


@dataclass(slots=True)
class PoseTrack:
    """Poses of one child in one parent over time, kept sorted, interpolated, never extrapolated beyond a limit.

    Attributes
    ----------
    extrapolation_limit_ns : int
        How far outside the span the nearest pose is still given, nanoseconds.
    broken : set of int
        Stamps before which poses were forgotten though one before them was kept: nothing is interpolated there.
    """

    extrapolation_limit_ns: int = 0
    stamps_ns: list[int] = field(default_factory=list)
    poses: dict[int, UncertainTransform] = field(default_factory=dict)
    broken: set[int] = field(default_factory=set)

    def insert(self, stamp_ns: int, pose: UncertainTransform) -> None:
        """Add a pose, or replace the one at the same stamp."""
        if stamp_ns not in self.poses:
            insort(self.stamps_ns, stamp_ns)
        self.poses[stamp_ns] = pose

    def forget_before(self, stamp_ns: int, keep_ns: Iterable[int] = ()) -> None:
        """Drop every pose before ``stamp_ns`` but the last of them, and those on either side of each of ``keep_ns``."""
        cut = max(bisect_left(self.stamps_ns, stamp_ns) - 1, 0)
        after = [bisect_right(self.stamps_ns, t) for t in keep_ns] if cut else []
        around = {i for k in after for i in (k - 1, k) if 0 <= i < cut}
        if len(around) == cut:
            return
        gone = False
        for i, stamp in enumerate(self.stamps_ns[: cut + 1]):
            if i == cut or i in around:
                if gone and around and i > min(around):
                    self.broken.add(stamp)
                gone = False
            else:
                del self.poses[stamp]
                gone = True
        self.stamps_ns[:cut] = [self.stamps_ns[i] for i in sorted(around)]
        self.broken = {s for s in self.broken if s in self.poses and s != self.stamps_ns[0]}

    def forget_after(self, stamp_ns: int) -> None:
        """Drop every pose after ``stamp_ns``: for a time line whose end is estimated anew."""
        cut = bisect_right(self.stamps_ns, stamp_ns)
        for old in self.stamps_ns[cut:]:
            del self.poses[old]
        del self.stamps_ns[cut:]

    def at(self, stamp_ns: int, what: str = "pose") -> UncertainTransform:
        """Return the pose at ``stamp_ns``.

        Raises
        ------
        ExtrapolationError
            If the track is empty or the stamp lies outside it by more than the limit.
        """
        if not self.stamps_ns:
            raise ExtrapolationError(f"{what}: no pose is known yet")
        i = bisect_left(self.stamps_ns, stamp_ns)
        if i < len(self.stamps_ns) and self.stamps_ns[i] == stamp_ns:
            return self.poses[stamp_ns]
        first, last = self.stamps_ns[0], self.stamps_ns[-1]
        if 0 < i < len(self.stamps_ns):
            a, b = self.stamps_ns[i - 1], self.stamps_ns[i]
            if b in self.broken:
                raise ExtrapolationError(f"{what} at t={stamp_ns}: forgotten from {a} to {b}")
            return interpolate(self.poses[a], self.poses[b], (stamp_ns - a) / (b - a))
        nearest = first if i == 0 else last
        if abs(stamp_ns - nearest) <= self.extrapolation_limit_ns:
            return self.poses[nearest]
        raise ExtrapolationError(
            f"{what} at t={stamp_ns}: known from {first} to {last}, "
            f"{abs(stamp_ns - nearest) / 1e9:.3f} s outside; ask inside that span"
        )


class FrameGraph:
    """A tree of frames; every frame but the root has one parent.

    Lookups compose along the chain over the common ancestor, with covariance where every edge has one.
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
        """The parent of a frame, or None for a root."""
        return self._parent.get(child)

    def set_static(self, parent: str, child: str, T_parent_child: UncertainTransform) -> None:
        """Set or replace the fixed edge from ``parent`` to ``child``."""
        self._attach(parent, child, T_parent_child)

    def track(self, parent: str, child: str, extrapolation_limit_ns: int = 0) -> PoseTrack:
        """Return the moving edge from ``parent`` to ``child``, made empty if it is new."""
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
            If a frame is unknown or no chain joins them.
        ExtrapolationError
            If a moving edge on the chain does not cover the time.
        """
        up_parent, up_child = self._chain(parent), self._chain(child)
        common = next((f for f in up_child if f in set(up_parent)), None)
        if common is None:
            raise FrameNotFoundError(
                f"no chain joins {parent} and {child}: their roots are {up_parent[-1]} and {up_child[-1]}"
            )
        T_common_parent = self._down(common, up_parent, stamp_ns)
        T_common_child = self._down(common, up_child, stamp_ns)
        return T_common_parent.inverse() @ T_common_child

    def _attach(self, parent: str, child: str, edge: UncertainTransform | PoseTrack) -> None:
        checked_frame(parent, "parent")
        checked_frame(child, "child")
        known = self._parent.get(child)
        if known is not None and known != parent:
            raise ConflictError(f"frame {child} hangs under {known}; it cannot also hang under {parent}")
        if child in self._chain_or_empty(parent):
            raise InputError(f"{parent} is below {child}: the edge would close a loop")
        self._roots.add(parent)
        self._roots.discard(child)
        self._parent[child] = parent
        self._edge[child] = edge

    def _chain(self, frame: str) -> list[str]:
        if frame not in self._parent and frame not in self._roots and frame not in self._parent.values():
            raise FrameNotFoundError(f"frame {frame!r} is not known; known are {', '.join(self.frames) or 'none'}")
        return self._chain_or_empty(frame)

    def _chain_or_empty(self, frame: str) -> list[str]:
        chain = [frame]
        while chain[-1] in self._parent:
            chain.append(self._parent[chain[-1]])
        return chain

    def _down(self, ancestor: str, chain_up: list[str], stamp_ns: int) -> UncertainTransform:
        T = UncertainTransform.identity()
        for frame in reversed(chain_up[: chain_up.index(ancestor)]):
            edge = self._edge[frame]
            step = edge.at(stamp_ns, f"{self._parent[frame]} to {frame}") if isinstance(edge, PoseTrack) else edge
            T = T @ step
        return T
