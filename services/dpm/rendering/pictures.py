# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of products for people: hillshade, hazard classes, a cloud or a path from above, as PNG."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.interfaces.product import Header
from cdff_common.raster.rendering import CLASS_COLORS, GROUND

RGBA = NDArray[np.uint8]

#: Types whose ``png`` is a picture of limited size.
DRAWN_TYPES = ("ElevationMap", "NavigationMap", "Pointcloud", "PoseTrajectory")
#: Longest side of a picture, pixels; larger rasters are subsampled.
MAX_SIDE_PX = 1024
#: Side of the picture of a cloud or a path, and number of points below which a point has 3 x 3 pixels.
_CLOUD_SIDE_PX = 320
_FEW_POINTS = 20_000
_GROUND = np.array(GROUND, dtype=np.float64)


def picture(value: Any, header: Header, max_side_px: int = MAX_SIDE_PX) -> bytes:
    """Return a PNG of a map, cloud, trajectory or image, +y of the frame up, transparent where unobserved.

    Raises
    ------
    InputError
        If the type has no picture.
    """
    kind = type(value).__name__
    match kind:
        case "ElevationMap":
            pixels = hillshade_rgba(np.asarray(value.layer("mean")), value.geometry.resolution_m)
        case "NavigationMap":
            pixels = CLASS_COLORS[np.minimum(np.asarray(value.layer("class")), 3)]
        case "Pointcloud":
            pixels = cloud_rgba(value.points_m, side_px=min(_CLOUD_SIDE_PX, max_side_px))
        case "PoseTrajectory":
            pixels = cloud_rgba(value.matrices[:, :3, 3], flat=True, side_px=min(_CLOUD_SIDE_PX, max_side_px))
        case "Frame":
            return _image(value.image, max_side_px)
        case _:
            raise InputError(f"a {kind} has no picture")
    return png(_subsampled(pixels, max_side_px))


def hillshade_rgba(heights_m: NDArray[Any], resolution_m: float) -> RGBA:
    """Return a shaded relief tinted by height, ``(rows, cols, 4)``; lit from the north-west, transparent
    where NaN.
    """
    from cdff_common.raster import hillshade

    heights = np.asarray(heights_m, dtype=np.float64)
    known = np.isfinite(heights)
    out = np.zeros((*heights.shape, 4), dtype=np.uint8)
    if not known.any():
        return out
    shade = hillshade(heights, resolution_m) / 255.0
    low, high = np.percentile(heights[known], [2, 98])
    level = np.clip((np.where(known, heights, low) - low) / max(high - low, 1e-9), 0.0, 1.0)
    out[..., :3] = np.clip(_tint(level) * (0.3 + 0.9 * shade)[..., None], 0, 255).astype(np.uint8)
    out[..., 3] = np.where(known, 255, 0)
    return out


def cloud_rgba(points_m: NDArray[Any], *, flat: bool = False, side_px: int = _CLOUD_SIDE_PX) -> RGBA:
    """Return points seen from above, ``(rows, cols, 4)``: the highest of each pixel, tinted by height."""
    points = np.asarray(points_m, dtype=np.float64)
    points = points[np.all(np.isfinite(points), axis=1)]
    if not len(points):
        return np.zeros((1, 1, 4), dtype=np.uint8)
    low, high = (
        np.percentile(points, [0.5, 99.5], axis=0)
        if len(points) > 200
        else (points.min(axis=0), points.max(axis=0))
    )
    span = max(float(high[0] - low[0]), float(high[1] - low[1]), 1e-6)
    scale = (side_px - 1) / span
    cols = np.round((points[:, 0] - low[0]) * scale).astype(np.int64)
    rows = np.round((high[1] - points[:, 1]) * scale).astype(np.int64)
    width, height = int((high[0] - low[0]) * scale) + 1, int((high[1] - low[1]) * scale) + 1
    inside = (cols >= 0) & (cols < width) & (rows >= 0) & (rows < height)
    cols, rows, z = cols[inside], rows[inside], points[inside, 2]
    level = (
        np.full(z.shape, 0.7)
        if flat
        else np.clip((z - low[2]) / max(float(high[2] - low[2]), 1e-9), 0.0, 1.0)
    )
    if len(z) < _FEW_POINTS:  # single pixels would be hard to see: a point is drawn 3 x 3
        steps = np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
        rows = np.clip((rows[:, None] + steps[:, 0]).ravel(), 0, height - 1)
        cols = np.clip((cols[:, None] + steps[:, 1]).ravel(), 0, width - 1)
        z, level = np.repeat(z, 9), np.repeat(level, 9)
    order = np.argsort(z, kind="stable")
    out = np.zeros((height, width, 4), dtype=np.uint8)
    out[rows[order], cols[order], :3] = _tint(level[order]).astype(np.uint8)
    out[rows[order], cols[order], 3] = 255
    return out


def _tint(level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the colours ``(..., 3)`` of levels from 0 to 1."""
    position = level * (len(_GROUND) - 1)
    below = np.minimum(position.astype(np.intp), len(_GROUND) - 2)
    part = (position - below)[..., None]
    return np.asarray(_GROUND[below] * (1.0 - part) + _GROUND[below + 1] * part)


def png(pixels: NDArray[Any]) -> bytes:
    """Return the PNG bytes of ``(rows, cols)`` or ``(rows, cols, 3 or 4)`` uint8."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "PNG")
    return buffer.getvalue()


def _subsampled(pixels: NDArray[Any], max_side_px: int) -> NDArray[Any]:
    step = -(-max(pixels.shape[:2]) // max_side_px)
    return pixels[::step, ::step]


def _image(image: NDArray[Any], max_side_px: int) -> bytes:
    pixels = np.asarray(image)
    if pixels.dtype != np.uint8:
        known = pixels[np.isfinite(pixels)]
        low, high = np.percentile(known, [1, 99]) if known.size else (0.0, 1.0)
        scaled = (np.nan_to_num(pixels.astype(np.float64), nan=low) - low) / max(float(high - low), 1e-9)
        pixels = (np.clip(scaled, 0, 1) * 255).astype(np.uint8)
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    return png(_subsampled(pixels, max_side_px))
