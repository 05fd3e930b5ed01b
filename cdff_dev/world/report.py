# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Worlds and their differences in words, and as plain data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cdff_common.clock import format_stamp
from cdff_common.value_text import value_lines
from cdff_common.world import World, WorldDifference, WorldEdge


def world_text(world: World) -> str:
    """Return time, frame tree, items and omissions of a world."""
    lines = [f"{len(world.frames)} frames, {len(world.items)} items at {format_stamp(world.stamp_ns)}"]
    for root in _roots(world):
        lines += _tree_lines(world, root, 0)
    for item in world.items:
        where = f" in {item.frame}" if item.frame else ""
        content = "not retrieved" if item.value is None else value_lines(item.value)[0]
        age_s = (world.stamp_ns - item.stamp_ns) * 1e-9
        lines.append(f"{item.name}  {item.type_name}{where}, {age_s:.3f} s old: {content}")
    lines += [f"omitted: {name}: {reason}" for name, reason in sorted(world.omitted.items())]
    return "\n".join(lines)


def world_to_dict(world: World) -> dict[str, Any]:
    """Return frames and items without their values, as plain data for JSON."""
    return {
        "stamp_ns": world.stamp_ns,
        "frames": [
            {
                "parent": edge.parent,
                "child": edge.child,
                "T": edge.transform.matrix,
                "covariance": edge.transform.covariance,
                "source": edge.source,
            }
            for edge in world.edges
        ],
        "items": [
            {
                "name": item.name,
                "type": item.type_name,
                "frame": item.frame,
                "stamp_ns": item.stamp_ns,
                "header": None if item.header is None else item.header.to_dict(),
            }
            for item in world.items
        ],
        "omitted": dict(world.omitted),
    }


def difference_text(difference: WorldDifference) -> str:
    """Return the changes from one world to another, one a line."""
    seconds = (difference.second_ns - difference.first_ns) * 1e-9
    lines = [f"from {format_stamp(difference.first_ns)} to {seconds:.3f} s later"]
    lines += [
        f"moved: {m.child} in {m.parent} by {m.distance_m:.3f} m, {np.degrees(m.angle_rad):.2f} degrees"
        for m in difference.motions
    ]
    named = {
        "frame added": difference.frames_added,
        "frame removed": difference.frames_removed,
        "other parent": difference.reparented,
        "item added": difference.items_added,
        "item removed": difference.items_removed,
        "newer item": difference.items_changed,
    }
    lines += [f"{label}: {name}" for label, names in named.items() for name in names]
    return "\n".join(lines if len(lines) > 1 else [*lines, "no change"])


def _roots(world: World) -> list[str]:
    children = {edge.child for edge in world.edges}
    return [frame for frame in world.frames if frame not in children]


def _tree_lines(world: World, frame: str, depth: int) -> Iterator[str]:
    if depth == 0:
        yield frame
    for edge in world.edges:
        if edge.parent == frame:
            yield f"{'  ' * (depth + 1)}{edge.child}: {_edge_text(edge)}"
            yield from _tree_lines(world, edge.child, depth + 1)


def _edge_text(edge: WorldEdge) -> str:
    """Return position and uncertainty of an edge as a text."""
    T = edge.transform
    x, y, z = T.matrix[:3, 3]
    text = f"x {x:.3f}, y {y:.3f}, z {z:.3f} m"
    if T.covariance is None:
        text += ", uncertainty unknown"
    elif T.covariance.any():
        text += f", sigma {np.sqrt(np.trace(T.covariance[:3, :3])):.3f} m"
    return f"{text} ({edge.source})" if edge.source else text
