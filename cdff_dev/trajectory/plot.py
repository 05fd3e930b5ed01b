# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Both trajectories from above and the error along the way, as one SVG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cdff_dev.trajectory.compare import Comparison
from cdff_dev.trajectory.track import Float

_WIDTH, _HEIGHT, _MARGIN = 520.0, 360.0, 52.0
_TICKS = 5


def drawn(found: Comparison) -> str:
    """SVG text: the two widest axes of the reference on the left, distances between the poses on the right."""
    first, second = sorted(np.argsort(np.ptp(found.reference.positions_m, axis=0))[-2:])
    tracks = [track.positions_m[:, [first, second]] for track in (found.reference, found.estimate)]
    errors = np.column_stack([found.reference.distances_m, found.position_errors_m])
    above = panel(0.0, tracks, ("#777777", "#c0392b"), (f"{'xyz'[first]} m", f"{'xyz'[second]} m"), equal=True)
    along = panel(_WIDTH, [errors], ("#c0392b",), ("way m", "error m"), equal=False)
    legend = (
        f'<text x="{_MARGIN}" y="18">reference</text><text x="{_MARGIN + 80}" y="18" fill="#c0392b">estimate</text>'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * _WIDTH:g} {_HEIGHT:g}" font-family="sans-serif" '
        f'font-size="12"><rect width="100%" height="100%" fill="white"/>{legend}{above}{along}</svg>\n'
    )


def panel(left: float, curves: Sequence[Float], colours: Sequence[str], labels: tuple[str, str], *, equal: bool) -> str:
    """Curves ``(n, 2)`` with axes; ``equal`` draws a metre as long in both."""
    points = np.vstack(curves)
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.maximum(high - low, 1e-9)
    room = np.array([_WIDTH - 1.5 * _MARGIN, _HEIGHT - 2.0 * _MARGIN])
    scale = np.full(2, (room / span).min()) if equal else room / span
    x0, y0 = left + _MARGIN, _HEIGHT - _MARGIN
    parts = [f'<path d="M{x0:.1f} {y0 - room[1]:.1f}V{y0:.1f}H{x0 + room[0]:.1f}" fill="none" stroke="black"/>']
    for value in np.linspace(0.0, room[0] / scale[0], _TICKS):
        x = x0 + value * scale[0]
        parts.append(f'<text x="{x:.1f}" y="{y0 + 16:.1f}" text-anchor="middle">{low[0] + value:.3g}</text>')
    for value in np.linspace(0.0, room[1] / scale[1], _TICKS):
        y = y0 - value * scale[1]
        parts.append(f'<text x="{x0 - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{low[1] + value:.3g}</text>')
    parts.append(f'<text x="{x0 + room[0] / 2:.1f}" y="{y0 + 36:.1f}" text-anchor="middle">{labels[0]}</text>')
    parts.append(f'<text x="{x0:.1f}" y="{y0 - room[1] - 10:.1f}">{labels[1]}</text>')
    for curve, colour in zip(curves, colours, strict=True):
        xy = np.column_stack([x0 + (curve[:, 0] - low[0]) * scale[0], y0 - (curve[:, 1] - low[1]) * scale[1]])
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in xy)
        parts.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
    return "".join(parts)
