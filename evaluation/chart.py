# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Diagrams of values with their intervals, for several methods."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cdff_dev.compare.diagrams import svg_text

_COLOURS = ("#c0392b", "#2c7fb8", "#777777", "#31a354")

#: Value, lower and upper end of its interval.
Bar = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Panel:
    """Content of one set of axes.

    Attributes
    ----------
    label : str
        Name of the values.
    categories : sequence of str
    methods : mapping of str to sequence of (value, low, high) or None
        One entry for each category; None is not drawn.
    top : float
        Upper end of the value axis, which starts at 0.
    band : tuple of float, optional
        Interval drawn in grey.
    """

    label: str
    categories: Sequence[str]
    methods: Mapping[str, Sequence[Bar | None]]
    top: float
    band: tuple[float, float] | None = None


def chart(panels: Sequence[Panel]) -> bytes:
    """Return the panels side by side, each with a legend of the methods, as SVG."""
    figure = Figure(figsize=(5.6 * len(panels), 3.2), layout="constrained")
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        _draw(axes, panel)
    return svg_text(figure).encode()


def _draw(axes: Axes, panel: Panel) -> None:
    if panel.band:
        axes.axhspan(*panel.band, color="#dddddd")
    for k, (method, bars) in enumerate(panel.methods.items()):
        offset = 0.14 * (k - 0.5 * (len(panel.methods) - 1))
        marks = [(i + offset, *bar) for i, bar in enumerate(bars) if bar is not None]
        x, value, low, high = np.array(marks).reshape(-1, 4).T
        axes.vlines(x, low, high, color=_COLOURS[k % len(_COLOURS)])
        axes.plot(x, value, "o", ms=5, color=_COLOURS[k % len(_COLOURS)], label=method)
    labels = [textwrap.fill(category, 16) for category in panel.categories]
    axes.set_xticks(range(len(labels)), labels, fontsize=8)
    axes.set(title=panel.label, xlim=(-0.5, len(panel.categories) - 0.5), ylim=(0.0, panel.top))
    axes.title.set_fontsize(9)
    axes.legend(fontsize=8)
