# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Diagrams as SVG text, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cdff_common.plots import figure_bytes

#: Size of a diagram with the view from above and the errors along the path, inches.
_SIZE_IN = (10.4, 3.6)


def svg_text(figure: Figure) -> str:
    """Return the SVG element of a figure; texts are text elements, and equal figures give equal bytes."""
    return figure_bytes(figure, "svg").decode()


def plan_and_errors(
    plan: Mapping[str, NDArray[np.float64]], axes: tuple[str, str], errors: Mapping[str, NDArray[np.float64]]
) -> str:
    """Return an SVG of curves seen from above, and of errors over the path length.

    Parameters
    ----------
    plan : mapping of str to ndarray, shape (n, 2)
        Curves by name, metres.
    axes : tuple of str
        Names of the two axes of the curves.
    errors : mapping of str to ndarray, shape (n, 2)
        Path lengths and errors by name, metres.
    """
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    above, along = figure.subplots(1, 2)
    _curves(above, plan, ("gray", "C3"), (f"{axes[0]}, m", f"{axes[1]}, m"))
    above.set_aspect("equal", adjustable="datalim")
    _curves(along, errors, ("C3", "C0"), ("path length, m", "error, m"))
    return svg_text(figure)


def _curves(
    axes: Axes, curves: Mapping[str, NDArray[np.float64]], colours: tuple[str, str], labels: tuple[str, str]
) -> None:
    for (name, curve), colour in zip(curves.items(), colours, strict=False):
        axes.plot(curve[:, 0], curve[:, 1], color=colour, lw=1.3, label=name)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.legend(fontsize=8)
