# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image pyramid with local normalisation, and selection of the pixels that are aligned on each level."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from cdff_core.imaging.pyramid import pyramid
from cdff_core.imaging.rectified_camera import RectifiedCamera

#: Edge of the window of the local mean and standard deviation, pixels of the level.
_WINDOW_PX = 21
#: Standard deviation of the noise of an image, grey levels: below it, a window is not amplified.
_NOISE_DN = 3.0
#: Smallest gradient of a selected pixel, in local standard deviations per pixel.
_MIN_GRADIENT = 0.1
#: Distance of a selected pixel from the image border, pixels of the level.
_MARGIN_PX = 3


def normalised_pyramid(image: ByteArray, levels: int) -> list[Float32Array]:
    """Return the levels of an image, each with the local mean removed and the local contrast equalised.

    Exposure, vignetting and shadows change the grey levels of a window by a gain and an offset, which this
    removes.
    """
    return [_normalised(level) for level in pyramid(image, levels)]


def _normalised(image: Float32Array) -> Float32Array:
    window = (_WINDOW_PX, _WINDOW_PX)
    mean = cv2.boxFilter(image, -1, window)
    variance = np.maximum(cv2.boxFilter(image * image, -1, window) - mean * mean, 0.0)
    return np.asarray((image - mean) / np.sqrt(variance + _NOISE_DN**2), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class SelectedPixels:
    """Pixels of one level of the reference."""

    values: FloatArray  # (n,), normalised grey levels
    pixels: FloatArray  # (n, 2), columns and rows at full resolution
    disparities: FloatArray  # (n,), pixels of the full resolution
    basis: FloatArray  # (n, 2), derivatives of the disparities by the parameters of the calibration

    @classmethod
    def of_level(
        cls, image: Float32Array, level: int, disparity: Float32Array, camera: RectifiedCamera, limit: int
    ) -> SelectedPixels:
        """Return the pixel with the largest gradient in each cell of a grid with at most ``limit`` cells."""
        scale = 2**level
        rows, cols = image.shape
        d = disparity[::scale, ::scale][:rows, :cols]
        gradients = cv2.Scharr(image, -1, 1, 0), cv2.Scharr(image, -1, 0, 1)
        strength = np.asarray(np.hypot(*gradients) / 32.0, np.float32)
        strength[~(np.isfinite(d) & (d > 0.0))] = 0.0
        for border in (np.s_[:_MARGIN_PX], np.s_[-_MARGIN_PX:]):
            strength[border] = strength[:, border] = 0.0
        cell = max(1, int(np.ceil(np.sqrt(rows * cols / limit))))
        row, col = _strongest_of_cells(strength, cell)
        pixels = np.column_stack([col, row]).astype(np.float64) * scale
        disparities = d[row, col].astype(np.float64)
        right = pixels - np.column_stack([disparities, np.zeros(len(disparities))])
        basis = calibration_basis(right, camera)
        return cls(image[row, col].astype(np.float64), pixels, disparities, basis)

    def corrected(self, calibration_px: FloatArray, errors_px: FloatArray) -> FloatArray:
        """Return the disparities (n,) plus errors (n,), corrected by the calibration (2,)."""
        return np.maximum(self.disparities + errors_px + self.basis @ calibration_px, 0.05)


def calibration_basis(right: FloatArray, camera: RectifiedCamera) -> FloatArray:
    """Return the derivatives (n, 2) of disparities by an offset and by the decentring.

    They are those of RectificationRefinement; ``right`` (n, 2) are columns and rows in the right image.
    """
    x, y = ((right - [camera.cx, camera.cy]) / [camera.fx, camera.fy]).T
    return np.column_stack([np.ones(len(right)), x**2 + y**2])


def _strongest_of_cells(strength: Float32Array, cell: int) -> tuple[IntArray, IntArray]:
    """Return row and column of the largest value of each cell, without cells below the smallest gradient."""
    rows, cols = strength.shape[0] // cell, strength.shape[1] // cell
    grid = strength[: rows * cell, : cols * cell].reshape(rows, cell, cols, cell).swapaxes(1, 2)
    blocks = grid.reshape(rows * cols, cell * cell)
    best = blocks.argmax(axis=1)
    (used,) = np.nonzero(blocks[np.arange(len(best)), best] >= _MIN_GRADIENT)
    best = best[used]
    return used // cols * cell + best // cell, used % cols * cell + best % cell


def usable_pixels(mask: BoolArray | None, image: Float32Array, level: int) -> BoolArray:
    """Return the usable pixels of a level; all without a mask."""
    if mask is None:
        return np.ones(image.shape, bool)
    scale = 2**level
    rows, cols = image.shape
    return np.ascontiguousarray(np.asarray(mask, bool)[::scale, ::scale][:rows, :cols])
