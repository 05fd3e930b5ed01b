# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of a trajectory and of a map as PNG, drawn by matplotlib."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.compare.trajectory.compare import Comparison
from cdff_dev.compare.trajectory.track import Track

_DPI = 120
#: Points drawn of a map, and quantiles of their heights at the ends of the colours.
_MAX_POINTS, _COLOUR_QUANTILES = 200_000, (0.02, 0.98)
_AXES = "xyz"


def trajectory_picture(track: Track, comparison: Comparison | None) -> bytes:
    """Return a PNG: the path from its longest side, and height or, with true poses, the error along it."""
    figure = Figure(figsize=(10.4, 4.2), layout="constrained")
    above, along = figure.subplots(1, 2)
    if comparison is None:
        x, y = _plane(track.positions_m)
        _path(above, track.positions_m, x, y, "C3", "estimate")
        for axis in range(3):
            along.plot(track.distances_m, track.positions_m[:, axis], lw=1.2, label=_AXES[axis])
        along.set(xlabel="path length, m", ylabel="position, m")
    else:
        x, y = _plane(comparison.reference.positions_m)
        _path(above, comparison.reference.positions_m, x, y, "gray", "truth")
        _path(above, comparison.estimate.positions_m, x, y, "C3", "estimate, aligned")
        along.plot(comparison.reference.distances_m, comparison.position_errors_m, color="C3", lw=1.2)
        along.set(xlabel="path length, m", ylabel="position error, m", ylim=(0.0, None))
    if along.get_legend_handles_labels()[0]:
        along.legend(fontsize=8)
    above.legend(fontsize=8)
    return _png(figure)


def map_picture(points_m: FloatArray, path_m: FloatArray) -> bytes:
    """Return a PNG of the points (n, 3) of a map seen along the axis across the path, with the path (m, 3).

    The colours are the coordinates along this axis.
    """
    x, y = _plane(path_m if np.ptp(path_m, axis=0).max() > 1.0 else points_m)
    z = 3 - x - y
    finite = points_m[np.isfinite(points_m).all(axis=1)]
    drawn = finite[:: max(1, len(finite) // _MAX_POINTS)]
    drawn = drawn[np.argsort(drawn[:, z])]
    low, high = np.quantile(drawn[:, z], _COLOUR_QUANTILES) if len(drawn) else (0.0, 1.0)
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    axes = figure.subplots()
    points = axes.scatter(drawn[:, x], drawn[:, y], c=drawn[:, z], s=0.3, vmin=low, vmax=high, cmap="viridis")
    figure.colorbar(points, ax=axes, label=f"{_AXES[z]}, m")
    _path(axes, path_m, x, y, "C3", "path")
    axes.legend(fontsize=8, loc="upper right")
    return _png(figure)


def _plane(positions_m: FloatArray) -> tuple[int, int]:
    """Return the two axes of largest extent."""
    x, y = sorted(int(axis) for axis in np.argsort(np.ptp(positions_m, axis=0))[-2:])
    return x, y


def _path(axes: Axes, positions_m: FloatArray, x: int, y: int, colour: str, label: str) -> None:
    axes.plot(positions_m[:, x], positions_m[:, y], color=colour, lw=1.3, label=label)
    axes.plot(positions_m[0, x], positions_m[0, y], "o", color=colour, ms=4)
    axes.set(xlabel=f"{_AXES[x]}, m", ylabel=f"{_AXES[y]}, m")
    axes.set_aspect("equal", adjustable="datalim")


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=_DPI)
    return out.getvalue()
