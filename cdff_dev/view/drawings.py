# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drawings, the same for every viewer: points, lines, surfaces, images, poses, numbers, texts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.rendering import VIRIDIS

Floats = NDArray[np.floating[Any]]
#: Colours as rows of red, green and blue, 0 to 255.
Colours = NDArray[np.uint8]

#: Colours by meaning.
GREY, BLUE, RED, GREEN, ORANGE = (150, 150, 150), (31, 119, 180), (214, 39, 40), (44, 160, 44), (255, 127, 14)
#: Quantiles of the values at the ends of the colours.
_COLOUR_QUANTILES = (0.02, 0.98)
_NODES = np.array(VIRIDIS, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points ``(n, 3)``, metres, with colours ``(n, 3)``."""

    points_m: Floats
    colours: Colours


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Polylines, each ``(n, 3)``, metres, of one colour."""

    lines_m: tuple[Floats, ...]
    colour: tuple[int, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles ``(m, 3)`` between vertices ``(n, 3)``, metres, with colours ``(n, 3)``."""

    vertices_m: Floats
    triangles: NDArray[np.uint32]
    colours: Colours


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Image ``(rows, cols)`` or ``(rows, cols, 3)`` red, green, blue, 8 bits.

    ``camera_matrix`` is that of the pinhole camera, None if unknown. ``picture`` is the layer of the image with
    the same pixels that it is laid over, empty if none.
    """

    pixels: NDArray[np.uint8]
    camera_matrix: Floats | None = None
    picture: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Positions ``(n, 2)`` in an image, pixels, with lines to other positions ``(n, 2)`` if there are any.

    ``picture`` is the layer of the image, empty if it is not known.
    """

    pixels: Floats
    ends: Floats | None = None
    picture: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Rectangles:
    """Rectangles ``(n, 4)`` in an image, left, top, width and height in pixels, with labels.

    ``picture`` is the layer of the image, empty if it is not known.
    """

    rectangles_px: Floats
    labels: tuple[str, ...]
    picture: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """``T_parent_child (4, 4)``."""

    parent: str
    child: str
    matrix: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoid:
    """Ellipsoid around a position; its rotation ``(3, 3)`` has the half axes as columns."""

    centre_m: Floats
    half_axes_m: Floats
    rotation: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Boxes of sizes ``(n, 3)`` at poses ``(n, 4, 4)``, metres, with labels."""

    poses: Floats
    sizes_m: Floats
    labels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Number:
    """A value of a plot over time; its unit is in the name of the layer."""

    value: float


@dataclass(frozen=True, slots=True)
class Note:
    """A line of text of a level: INFO, WARN or ERROR."""

    level: str
    text: str


Drawing = (
    Points | Lines | Surface | Picture | Marks | Rectangles | Transform | Ellipsoid | Boxes | Number | Note
)


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A drawing with its place.

    Attributes
    ----------
    path : str
        Name of the layer: ``/robot/sensor/stream…``; a later drawing of that name replaces it.
    frame : str
        Frame of its coordinates; empty without coordinates.
    drawing : Drawing
    """

    path: str
    frame: str
    drawing: Drawing


class Scene(Protocol):
    """A viewer, or a file of one."""

    def put(self, stamp_ns: int, layer: Layer) -> None:
        """Show a layer from a mission time on."""

    def close(self) -> None:
        """Complete the file, or flush the connection."""


def colours_of(values: Floats) -> Colours:
    """Return colours ``(…, 3)`` of viridis from the lowest to the highest values; grey for NaN."""
    values = np.asarray(values, dtype=np.float64)
    finite = values[np.isfinite(values)]
    low, high = np.quantile(finite, _COLOUR_QUANTILES) if finite.size else (0.0, 1.0)
    position = np.clip((values - low) / max(float(high - low), 1e-12), 0.0, 1.0) * (len(_NODES) - 1)
    known = np.nan_to_num(position)
    nodes = np.arange(len(_NODES))
    colours = np.stack([np.interp(known, nodes, _NODES[:, i]) for i in range(3)], axis=-1)
    colours[~np.isfinite(values)] = GREY
    return colours.astype(np.uint8)
