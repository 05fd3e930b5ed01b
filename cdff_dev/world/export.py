# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of what an export of a world contains."""

from __future__ import annotations

from collections import Counter

from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.world import World


def most_connected_root(world: World) -> str:
    """Return the root with most frames below it; raises InputError for a world without frames."""
    parent_of = {edge.child: edge.parent for edge in world.edges}
    counts: Counter[str] = Counter()
    for frame in world.frames:
        while frame in parent_of:
            frame = parent_of[frame]
        counts[frame] += 1
    if not counts:
        frames = sorted({item.frame for item in world.items if item.frame})
        if not frames:
            raise InputError("the world has no frames at this time: nothing to export")
        return frames[0]
    return min(counts, key=lambda frame: (-counts[frame], frame))


def pose_in(world: World, root: str, frame: str) -> UncertainTransform | None:
    """Return ``T_root_frame``; None if they are not connected."""
    if root == frame:
        return UncertainTransform.identity()
    try:
        return world.transform(root, frame)
    except FrameNotFoundError:
        return None
