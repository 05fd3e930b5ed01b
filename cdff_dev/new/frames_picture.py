# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Picture of the frames of a robot as SVG: from above and from the right, x red, y green, z blue."""

from __future__ import annotations

from html import escape

import numpy as np

from cdff_common.geometry import FrameGraph
from cdff_common.geometry.se3 import FloatArray

_COLOURS = ("#d62728", "#2ca02c", "#1f77b4")
#: Size of a panel, its margin, and length of an axis, pixels.
_SIZE_PX, _MARGIN_PX, _AXIS_PX = 420, 70, 44
#: Axes of the base that point right and up in each panel, and the sign of the one that points up.
_PANELS = (("from above", 0, 1), ("from the right", 0, 2))


def frames_svg(graph: FrameGraph, robot: str) -> str:
    """Return the frames below ``{robot}/base``, drawn in the axes of the base, with positions in metres."""
    base = f"{robot}/base"
    frames = [
        f for f in graph.frames if f != base and f.startswith(f"{robot}/") and _is_below(graph, f, base)
    ]
    poses = {base: np.eye(4)} | {f: graph.lookup(base, f, 0).matrix for f in sorted(frames)}
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{2 * _SIZE_PX}" height="{_SIZE_PX + 30}" '
        f'font-family="sans-serif" font-size="11" role="img">',
        f"<title>Frames of {escape(robot)}: x red, y green, z blue</title>",
        '<rect width="100%" height="100%" fill="#ffffff"/>',
    ]
    positions = np.array([T[:3, 3] for T in poses.values()])
    centre = 0.5 * (positions.min(axis=0) + positions.max(axis=0))
    extent_m = max(float((positions.max(axis=0) - positions.min(axis=0)).max()), 0.2)
    scale = (_SIZE_PX - 2 * _MARGIN_PX) / extent_m
    for number, (title, right, up) in enumerate(_PANELS):
        parts.append(f'<text x="{number * _SIZE_PX + 12}" y="20" font-size="14">{title}</text>')
        labels: dict[tuple[int, int], int] = {}
        for frame, T in poses.items():
            x = number * _SIZE_PX + _SIZE_PX / 2 + scale * (T[right, 3] - centre[right])
            y = 15 + _SIZE_PX / 2 - scale * (T[up, 3] - centre[up])
            parts += _axes(T, x, y, right, up)
            cell = (round(x / 40), round(y / 40))
            labels[cell] = labels.get(cell, 0) + 1
            name = escape(frame.partition("/")[2])
            parts.append(f'<text x="{x + 8:.0f}" y="{y + 2 + 13 * labels[cell]:.0f}">{name}</text>')
    parts.append(
        f'<line x1="12" y1="{_SIZE_PX + 18}" x2="{12 + scale * 0.1:.1f}" y2="{_SIZE_PX + 18}" stroke="#000"/>'
        f'<text x="{18 + scale * 0.1:.0f}" y="{_SIZE_PX + 22}">0.1 m; x red (forward at the base), '
        "y green (left), z blue (up); a dot points at you, a cross away</text>"
    )
    return "\n".join([*parts, "</svg>"]) + "\n"


def _is_below(graph: FrameGraph, frame: str, base: str) -> bool:
    """Return whether a frame is the base or a descendant of it."""
    parent: str | None = frame
    while parent is not None and parent != base:
        parent = graph.parent_of(parent)
    return parent == base


def _axes(T: FloatArray, x: float, y: float, right: int, up: int) -> list[str]:
    """Return lines of the three axes of a frame; an axis along the view is a dot or a cross."""
    away = 3 - right - up
    towards = 1.0 if away == 2 else -1.0  # seen from +z, and from -y
    parts = []
    for axis, colour in enumerate(_COLOURS):
        direction = T[:3, axis]
        dx, dy = _AXIS_PX * direction[right], -_AXIS_PX * direction[up]
        if np.hypot(dx, dy) < 0.15 * _AXIS_PX:
            if direction[away] * towards > 0:
                parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>')
            else:
                path = f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8"
                parts.append(f'<path d="{path}" stroke="{colour}" stroke-width="2"/>')
            continue
        line = f'x1="{x:.1f}" y1="{y:.1f}" x2="{x + dx:.1f}" y2="{y + dy:.1f}"'
        parts.append(f'<line {line} stroke="{colour}" stroke-width="2"/>')
        parts.append(f'<circle cx="{x + dx:.1f}" cy="{y + dy:.1f}" r="2.5" fill="{colour}"/>')
    return parts
