# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values with their intervals, side by side for several methods, as one SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 560.0, 320.0, 62.0, 14.0, 46.0, 44.0
_COLOURS = ("#c0392b", "#2c7fb8", "#777777", "#31a354")

#: Value, and the ends of its interval.
Bar = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Panel:
    """One set of axes.

    Attributes
    ----------
    label : str
        Of the values.
    categories : sequence of str
    methods : mapping of str to sequence of (value, low, high) or None
        One entry a category; None leaves it out.
    top : float
        Where the axis ends; it begins at 0.
    band : tuple of float, optional
        Drawn grey across.
    """

    label: str
    categories: Sequence[str]
    methods: Mapping[str, Sequence[Bar | None]]
    top: float
    band: tuple[float, float] | None = None


def chart(panels: Sequence[Panel]) -> bytes:
    """The panels beside one another, with a legend of the methods above each."""
    body = "".join(_drawn(panel, index * _WIDTH) for index, panel in enumerate(panels))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {len(panels) * _WIDTH:g} {_HEIGHT:g}" '
        f'font-family="sans-serif" font-size="12"><rect width="100%" height="100%" fill="white"/>{body}</svg>\n'
    ).encode()


def _drawn(panel: Panel, left: float) -> str:
    x0, x1, y0, y1 = left + _LEFT, left + _WIDTH - _RIGHT, _HEIGHT - _BOTTOM, _TOP
    height = (y0 - y1) / panel.top

    def y(value: float) -> float:
        return y0 - height * min(max(value, 0.0), panel.top)

    parts = [f'<text x="{x0:.1f}" y="{y1 - 8:.1f}">{panel.label}</text>']
    if panel.band:
        low, high = y(panel.band[0]), y(panel.band[1])
        parts.append(
            f'<rect x="{x0:.1f}" y="{high:.1f}" width="{x1 - x0:.1f}" height="{low - high:.1f}" fill="#dddddd"/>'
        )
    parts.append(f'<path d="M{x0:.1f} {y1:.1f}V{y0:.1f}H{x1:.1f}" fill="none" stroke="black"/>')
    for value in _ticks(panel.top):
        parts.append(f'<text x="{x0 - 6:.1f}" y="{y(value) + 4:.1f}" text-anchor="end">{value:g}</text>')
        parts.append(f'<path d="M{x0 - 3:.1f} {y(value):.1f}h3" stroke="black"/>')
    step = (x1 - x0) / len(panel.categories)
    for i, category in enumerate(panel.categories):
        parts.append(f'<text x="{x0 + (i + 0.5) * step:.1f}" y="{y0 + 18:.1f}" text-anchor="middle">{category}</text>')
    for k, (method, bars) in enumerate(panel.methods.items()):
        colour = _COLOURS[k % len(_COLOURS)]
        parts.append(f'<text x="{x0 + 110 * k:.1f}" y="16" fill="{colour}">{method}</text>')
        for i, bar in enumerate(bars):
            if bar is None:
                continue
            x = x0 + (i + 0.5 + 0.14 * (k - 0.5 * (len(panel.methods) - 1))) * step
            value, low, high = bar
            parts.append(f'<path d="M{x:.1f} {y(low):.1f}V{y(high):.1f}" stroke="{colour}" stroke-width="2"/>')
            parts.append(f'<circle cx="{x:.1f}" cy="{y(value):.1f}" r="4" fill="{colour}"/>')
    return "".join(parts)


def _ticks(top: float) -> list[float]:
    """Four to eight round values from 0 to the top."""
    step = 10.0 ** math.floor(math.log10(top))
    while top / step < 4.0:
        step /= 2.0 if round(step / 10.0 ** math.floor(math.log10(step)), 6) != 5.0 else 2.5
    return [round(i * step, 10) for i in range(math.floor(top / step + 1e-9) + 1)]
