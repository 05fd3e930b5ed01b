# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rendering of elevation and navigation maps as indices into a palette; unobserved cells are 0, transparent.

Every style except the relief has a fixed range, so that neighbouring tiles show equal heights in equal
colours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.slope import hillshade, slope_rad

Indices = NDArray[np.uint8]
Palette = NDArray[np.uint8]

#: Number of tints of the relief; tints times shades fill a palette.
_TINTS = 15
#: Number of brightness levels of the relief.
_SHADES = 17


@dataclass(frozen=True, slots=True)
class LayerStyle:
    """Style of a layer.

    Attributes
    ----------
    title : str
    unit : str
    low, high : float
        Default range; values outside get the colour of the nearer bound.
    palette : Palette, shape (256, 3)
    """

    title: str
    unit: str
    low: float
    high: float
    palette: Palette


@dataclass(frozen=True, slots=True)
class ElevationStyle(LayerStyle):
    """Style of a layer computed from elevation.

    Attributes
    ----------
    value : callable
        Function from heights and variances ``(rows, cols)`` with a margin of one cell, and the cell size, to
        values ``(rows - 2, cols - 2)`` in ``unit``, NaN where unknown.
    """

    value: Callable[[NDArray[np.float32], NDArray[np.float32], float], NDArray[np.float32]]


@dataclass(frozen=True, slots=True)
class NavigationStyle(LayerStyle):
    """Style of a layer of navigation maps.

    Attributes
    ----------
    value : callable
        Function from layers ``(rows, cols)`` of a navigation map to values, NaN where unknown.
    """

    value: Callable[[Mapping[str, NDArray[Any]]], NDArray[np.float32]]


def _ramp(*colors: tuple[int, int, int]) -> Palette:
    """Return a palette interpolated between colours; index 0 is transparent."""
    at = np.linspace(1, 255, len(colors))
    channels = [np.interp(np.arange(256), at, [color[i] for color in colors]) for i in range(3)]
    return np.stack(channels, axis=1).round().astype(np.uint8)


#: Low to high ground, ochre to pale; suitable for colour-blind readers.
GROUND = ((88, 62, 48), (150, 104, 72), (204, 158, 112), (240, 222, 190))


def _inner(values: NDArray[np.floating]) -> NDArray[np.float32]:
    return values[1:-1, 1:-1].astype(np.float32)


def _shade(heights: NDArray[np.float32], _: NDArray[np.float32], cell_m: float) -> NDArray[np.float32]:
    shade = hillshade(heights, cell_m)[1:-1, 1:-1].astype(np.float32)
    shade[shade == 0] = np.nan
    return shade


def _slope(heights: NDArray[np.float32], _: NDArray[np.float32], cell_m: float) -> NDArray[np.float32]:
    return _inner(np.degrees(slope_rad(heights, cell_m)))


def _roughness(heights: NDArray[np.float32], _: NDArray[np.float32], cell_m: float) -> NDArray[np.float32]:
    from cdff_common.raster.surface import local_surface

    unknown = np.full(heights.shape, np.nan)
    return _inner(local_surface(heights, unknown, cell_m).roughness_m)


VIRIDIS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
RENDERINGS = {
    "elevation": ElevationStyle("Height", "m", -8.0, 8.0, _ramp(*GROUND), lambda h, _v, _m: _inner(h)),
    "hillshade": ElevationStyle("Shaded relief", "1", 1.0, 255.0, _ramp((0, 0, 0), (255, 255, 255)), _shade),
    "slope": ElevationStyle("Slope", "deg", 0.0, 40.0, _ramp(*VIRIDIS), _slope),
    "roughness": ElevationStyle("Roughness of 3 x 3 cells", "m", 0.0, 0.1, _ramp(*VIRIDIS), _roughness),
    "variance": ElevationStyle(
        "Variance of the height", "m2", 0.0, 0.01, _ramp(*VIRIDIS), lambda _h, v, _m: _inner(v)
    ),
}

#: Analyses of heights, which are the mean of their layers; each needs parameters.
ANALYSES = {
    "contours": LayerStyle("Contour lines", "m", -8.0, 8.0, _ramp((40, 26, 13), (40, 26, 13))),
    "difference": LayerStyle(
        "Change of the height", "m", -0.5, 0.5, _ramp((5, 48, 97), (247, 247, 247), (103, 0, 31))
    ),
    "viewshed": LayerStyle(
        "Probability of visibility", "1", 0.0, 1.0, _ramp((60, 20, 90), (160, 160, 160), (250, 240, 120))
    ),
}


def contour_cells(heights: NDArray[np.floating], interval_m: float) -> NDArray[np.float32]:
    """Return the heights of contour lines in the cells ``(rows, cols)`` that they cross, NaN elsewhere.

    A line crosses the higher one of two adjacent cells. The last row and column have no line of their own.
    """
    z = np.asarray(heights, dtype=np.float64)
    levels = np.floor(z / interval_m)
    result = np.full(z.shape, np.nan, dtype=np.float32)
    for axis in (0, 1):
        first, second = (levels[:-1], levels[1:]) if axis == 0 else (levels[:, :-1], levels[:, 1:])
        lines = (result[:-1], result[1:]) if axis == 0 else (result[:, :-1], result[:, 1:])
        with np.errstate(invalid="ignore"):
            np.copyto(lines[0], (first * interval_m).astype(np.float32), where=first > second)
            np.copyto(lines[1], (second * interval_m).astype(np.float32), where=second > first)
    return result


#: Red, green, blue, alpha of the classes unknown, safe, caution, hazard.
CLASS_COLORS = np.array(
    [[0, 0, 0, 0], [70, 150, 90, 255], [230, 180, 60, 255], [190, 60, 50, 255]], dtype=np.uint8
)


def _classes(layers: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
    classes = layers["class"].astype(np.float32)
    classes[classes == 0] = np.nan
    return classes


def _cost(layers: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
    classes = layers["class"]
    return np.asarray(layers.get("cost", np.full(classes.shape, np.nan)), dtype=np.float32)


#: Palette of the classes: the value is the index of the colour.
NAVIGATION = {
    "navigation_map": NavigationStyle(
        "Where a rover may drive",
        "1",
        1.0,
        255.0,
        np.vstack([CLASS_COLORS[:, :3], np.zeros((252, 3), np.uint8)]),
        _classes,
    ),
    "cost": NavigationStyle("Cost of driving", "1", 0.0, 1.0, _ramp(*VIRIDIS), _cost),
}


def indices(values: NDArray[np.float32], low: float, high: float) -> Indices:
    """Return indices 1 to 255 of values between ``low`` and ``high``; 0 for NaN."""
    known = np.isfinite(values)
    level = (np.where(known, values, low) - low) * (254.0 / (high - low))
    return np.where(known, 1.5 + np.clip(level, 0.0, 254.0), 0.0).astype(np.uint8)


def relief(heights: NDArray[np.float32], cell_m: float, low: float, high: float) -> tuple[Indices, Palette]:
    """Return indices ``(rows - 2, cols - 2)`` of a shaded relief tinted by height, and its palette."""
    shade = hillshade(heights, cell_m)[1:-1, 1:-1]
    inner = _inner(heights)
    known = np.isfinite(inner)
    tint = np.clip((np.where(known, inner, low) - low) * (_TINTS / (high - low)), 0, _TINTS - 1).astype(
        np.uint8
    )
    palette_indices = np.where(
        known, 1 + tint * _SHADES + (shade // (256 // _SHADES + 1)).astype(np.uint8), 0
    )
    return palette_indices.astype(np.uint8), _RELIEF


def _relief_palette() -> Palette:
    tints = _ramp(*GROUND)[np.linspace(1, 255, _TINTS).astype(int)].astype(np.float64)
    lights = 0.3 + 0.9 * (np.arange(_SHADES) + 0.5) / _SHADES
    palette = np.zeros((256, 3))
    palette[1 : 1 + _TINTS * _SHADES] = np.clip(tints[:, None, :] * lights[None, :, None], 0, 255).reshape(
        -1, 3
    )
    return palette.round().astype(np.uint8)


_RELIEF = _relief_palette()
RELIEF_STYLE = LayerStyle("Relief tinted by height", "m", -8.0, 8.0, _RELIEF)
