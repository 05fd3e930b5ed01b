# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tree of frames with static and moving edges, as in EnviRe, and transforms between any two frames."""

from __future__ import annotations

import re

from cdff_common.errors import ConflictError, FrameNotFoundError, InputError
from cdff_common.geometry.pose_track import PoseTrack
from cdff_common.geometry.uncertain_transform import UncertainTransform

_FRAME = re.compile(r"[a-z0-9_]+(/[a-z0-9_]+)*\Z")


def checked_frame(frame: str, name: str = "frame") -> str:
    """Return a valid frame id; raises InputError for others."""
    if len(frame) > 128 or not _FRAME.match(frame):
        raise InputError(f"{name}={frame!r}: expected [a-z0-9_]+(/[a-z0-9_]+)*, e.g. site or mana/base")
    return frame


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
