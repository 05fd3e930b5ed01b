# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drawing of arrays on the axes of a figure: paths, clouds, heights, classes and images."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.extras import import_extra
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.slope import hillshade

_AXES = "xyz"
#: Points drawn of a cloud, and quantiles of the values at the ends of the colours.
_MAX_POINTS, _COLOUR_QUANTILES = 200_000, (0.02, 0.98)
#: Cells or pixels drawn along the longest side of a raster; larger rasters are subsampled.
_MAX_SIDE = 2000
#: Factor on heights of the shading, so that flat terrain shows relief.
_EXAGGERATION = 2.0
_CLASSES = ("unknown", "safe", "caution", "hazard")


def widest_plane(positions_m: NDArray[Any]) -> tuple[int, int]:
    """Return the two axes of largest extent of positions ``(n, 3)``, in ascending order."""
    largest = np.argsort(-np.ptp(positions_m, axis=0), kind="stable")[:2]
    x, y = sorted(int(axis) for axis in largest)
    return x, y


def draw_path(
    axes: Any,
    positions_m: NDArray[Any],
    plane: tuple[int, int],
    colour: str,
    label: str,
    width_pt: float = 1.3,
) -> None:
    """Draw a path ``(n, 3)`` with a dot at its start, in the plane of two axes."""
    x, y = plane
    axes.plot(positions_m[:, x], positions_m[:, y], color=colour, lw=width_pt, label=label)
    axes.plot(positions_m[:1, x], positions_m[:1, y], "o", color=colour, ms=4)
    _metres(axes, plane)


def draw_cloud(figure: Any, axes: Any, points_m: NDArray[Any], plane: tuple[int, int] = (0, 1)) -> None:
    """Draw points ``(n, 3)`` along the third axis, whose coordinates are the colours."""
    x, y = plane
    z = 3 - x - y
    finite = points_m[np.isfinite(points_m).all(axis=1)]
    drawn_points = finite[:: max(1, len(finite) // _MAX_POINTS)]
    drawn_points = drawn_points[np.argsort(drawn_points[:, z])]
    low, high = colour_range(drawn_points[:, z])
    size = float(np.clip(2e4 / max(len(drawn_points), 1), 0.3, 12.0))
    points = axes.scatter(
        drawn_points[:, x],
        drawn_points[:, y],
        c=drawn_points[:, z],
        s=size,
        lw=0,
        vmin=low,
        vmax=high,
        cmap="viridis",
    )
    figure.colorbar(points, ax=axes, label=f"{_AXES[z]}, m")
    _metres(axes, plane)


def draw_heights(
    figure: Any,
    axes: Any,
    heights_m: NDArray[Any],
    geometry: GridGeometry,
    limits_m: tuple[float, float] | None = None,
) -> None:
    """Draw the known heights of ``(rows, cols)`` in colours under a relief lit from the north-west.

    ``limits_m`` are the heights at the ends of the colours, by default quantiles of the heights.
    """
    step, extent = _step(heights_m), _extent(geometry)
    cells = np.asarray(heights_m, dtype=np.float64)[::step, ::step]
    edge_m = geometry.resolution_m * step
    low, high = limits_m or colour_range(cells)
    image = axes.imshow(cells, cmap="terrain", vmin=low, vmax=high, extent=extent)
    shade = hillshade(cells, edge_m, exaggeration=_EXAGGERATION)
    relief = np.where(np.isfinite(cells) & (shade > 0), shade.astype(np.float64), np.nan)
    axes.imshow(relief, cmap="gray", vmin=0.0, vmax=255.0, alpha=0.35, extent=extent)
    figure.colorbar(image, ax=axes, label="height, m")
    _metres(axes, (0, 1))
    rows, cols = np.nonzero(np.isfinite(cells))
    if len(rows):
        x_m, y_m = geometry.xmin_m + cols * edge_m, geometry.ymax_m - rows * edge_m
        axes.set(xlim=(x_m.min(), x_m.max() + edge_m), ylim=(y_m.min() - edge_m, y_m.max()))
        axes.set_aspect("equal", adjustable="box")


def draw_differences(
    figure: Any, axes: Any, differences_m: NDArray[Any], geometry: GridGeometry, label: str
) -> None:
    """Draw differences ``(rows, cols)`` of two maps, red above and blue below zero, which is white."""
    step = _step(differences_m)
    cells = np.asarray(differences_m, dtype=np.float64)[::step, ::step]
    finite = np.abs(cells[np.isfinite(cells)])
    limit = float(np.quantile(finite, _COLOUR_QUANTILES[1])) if len(finite) else 1.0
    limit = limit or 1.0
    image = axes.imshow(cells, cmap="RdBu_r", vmin=-limit, vmax=limit, extent=_extent(geometry))
    axes.set_facecolor("lightgray")  # unknown, unlike zero
    figure.colorbar(image, ax=axes, label=label, extend="both")
    _metres(axes, (0, 1))
    axes.set_aspect("equal", adjustable="box")


def draw_classes(figure: Any, axes: Any, classes: NDArray[Any], geometry: GridGeometry) -> None:
    """Draw the classes ``(rows, cols)`` of a navigation map with a bar of their names."""
    from cdff_common.raster.rendering import CLASS_COLORS

    step = _step(classes)
    colours = import_extra("matplotlib.colors").ListedColormap(CLASS_COLORS / 255.0)
    cells = np.minimum(classes, 3)[::step, ::step]
    image = axes.imshow(cells, cmap=colours, vmin=-0.5, vmax=3.5, extent=_extent(geometry))
    bar = figure.colorbar(image, ax=axes, ticks=range(4))
    bar.ax.set_yticklabels(_CLASSES)
    _metres(axes, (0, 1))


def draw_image(figure: Any, axes: Any, image: NDArray[Any], label: str = "value") -> None:
    """Draw an image ``(rows, cols)`` or ``(rows, cols, 3)``; numbers other than 8 bits with a colour bar."""
    step = _step(image)
    pixels = image[::step, ::step]
    rows, cols = image.shape[:2]
    extent = (-0.5, cols - 0.5, rows - 0.5, -0.5)
    if pixels.ndim == 3 or pixels.dtype == np.uint8:
        axes.imshow(pixels, cmap="gray", vmin=0, vmax=255, extent=extent)
    else:
        values = np.where(np.isfinite(pixels), pixels, np.nan)
        low, high = colour_range(values)
        mappable = axes.imshow(values, cmap="viridis", vmin=low, vmax=high, extent=extent)
        figure.colorbar(mappable, ax=axes, label=label)
    axes.set(xlabel="column, px", ylabel="row, px")


def draw_axes(axes: Any, matrices: NDArray[Any], plane: tuple[int, int], length_m: float) -> None:
    """Draw the x and y axes of poses ``(n, 4, 4)`` in red and green, in the plane of two axes."""
    x, y = plane
    for column, colour in enumerate(("C3", "C2")):
        tip = matrices[:, :3, 3] + length_m * matrices[:, :3, column]
        for pose, end in zip(matrices, tip, strict=True):
            axes.plot([pose[x, 3], end[x]], [pose[y, 3], end[y]], color=colour, lw=1.5)


def _metres(axes: Any, plane: tuple[int, int]) -> None:
    axes.set(xlabel=f"{_AXES[plane[0]]}, m", ylabel=f"{_AXES[plane[1]]}, m")
    axes.set_aspect("equal", adjustable="datalim")


def _extent(geometry: GridGeometry) -> tuple[float, float, float, float]:
    """Return x and y at the edges of a grid, as matplotlib expects them, metres."""
    width_m, height_m = geometry.cols * geometry.resolution_m, geometry.rows * geometry.resolution_m
    return geometry.xmin_m, geometry.xmin_m + width_m, geometry.ymax_m - height_m, geometry.ymax_m


def _step(raster: NDArray[Any]) -> int:
    return max(1, -(-max(int(side) for side in raster.shape[:2]) // _MAX_SIDE))


def colour_range(values: NDArray[Any]) -> tuple[float, float]:
    """Return quantiles of the finite values as the ends of the colours."""
    finite = values[np.isfinite(values)]
    low, high = np.quantile(finite, _COLOUR_QUANTILES) if len(finite) else (0.0, 1.0)
    return (float(low), float(high)) if high > low else (float(low) - 0.5, float(low) + 0.5)
