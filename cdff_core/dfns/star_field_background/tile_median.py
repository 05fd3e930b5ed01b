# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Background and noise by the medians of tiles."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.arrays import ByteArray, Float32Array, FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.star_field_background._kernels import (
    mark_trails,
    ordered_statistics,
    subtract_background,
)
from cdff_core.dfns.star_field_background.interface import Inputs, Interface, Outputs

#: Smallest image, pixels, and the fraction of saturated pixels from which the image is refused.
_MIN_SIZE_PX, _MAX_SATURATED = 64, 0.5
#: Value of the mask in trails of satellites and cosmic rays.
_TRAIL = 2
#: Variance of the rounding to steps of one DN.
_ROUNDING_VARIANCE = 1.0 / 12.0


class TileMedianConfig(DfnConfig):
    """Parameters of TileMedian."""

    tile_px: int = Field(
        64, ge=16, le=512, description="Side of the tiles, px: larger than a resolved target"
    )
    step_px: int = Field(4, ge=1, le=8, description="Step between the pixels of a tile that are used, px")
    trail_sigmas: float = Field(
        3.0,
        ge=2.0,
        le=50.0,
        description="Brightness of a trail, standard deviations of the mean of 3 x 3 pixels",
    )
    trail_length_px: float = Field(
        40.0, ge=10.0, le=1e4, description="Length from which a thin region is a trail, px"
    )


class TileMedian(Interface[TileMedianConfig]):
    """Median of each tile, interpolated linearly; tiles with bright sources are replaced, as in SExtractor
    [1]_.

    References
    ----------
    .. [1] Bertin, E., Arnouts, S. (1996). SExtractor: Software for source extraction. Astronomy and
       Astrophysics
      Supplement 117. doi:10.1051/aas:1996164
    """

    def setup(self) -> None:
        """Compile the kernels; allocate the memory that every image uses again."""
        self._smooth, self._labels = _memory((0, 0))
        image = np.zeros((16, 16), np.float32)
        ordered_statistics(image)
        tiles = np.zeros((5, 5))
        subtract_background(image, tiles, tiles, 8, 8, image.copy(), image + 1)
        smooth, labels = _memory(image.shape)
        mark_trails(smooth, image + 1, image.astype(np.uint8), labels, 4.0, 64.0, _TRAIL)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the residual, its noise and the mask.

        Raises
        ------
        InputError
            If the image is smaller than 64 x 64 pixels.
        RefusedError
            If more than half of the image is saturated.
        """
        image = np.ascontiguousarray(inputs.image, np.float32)
        rows, cols = image.shape
        if min(rows, cols) < _MIN_SIZE_PX:
            raise InputError(f"image {image.shape}: expected at least {_MIN_SIZE_PX} x {_MIN_SIZE_PX} pixels")
        mask = np.zeros(image.shape, np.uint8)
        saturated = 0.0
        if np.isfinite(inputs.saturation):
            mask = (image >= inputs.saturation).view(np.uint8)
            saturated = cv2.countNonZero(mask) / image.size
        if saturated > _MAX_SATURATED:
            raise RefusedError(
                f"image: {saturated:.0%} of the pixels are saturated, expected at most {_MAX_SATURATED:.0%}; "
                "shorten the exposure",
                reasons=[f"saturated:{saturated:.2f}>{_MAX_SATURATED:g}"],
            )
        counts = (max(rows // self.config.tile_px, 1), max(cols // self.config.tile_px, 1))
        sides = (rows // counts[0], cols // counts[1])
        levels, sigmas = tile_statistics(image, counts, sides, self.config.step_px)
        smooth = np.asarray(cv2.medianBlur(sigmas.astype(np.float32), 3), dtype=np.float64)
        residual, noise = np.empty_like(image), np.empty_like(image)
        subtract_background(
            image,
            _with_border(_without_sources(levels, sigmas)),
            _with_border(np.sqrt(smooth**2 + _ROUNDING_VARIANCE)),
            *sides,
            residual,
            noise,
        )
        self._mark_trails(residual, noise, mask)
        return Outputs(residual=residual, noise=noise, mask=mask, saturated=saturated)

    def _mark_trails(self, residual: Float32Array, noise: Float32Array, mask: ByteArray) -> None:
        """Set the pixels of trails in the mask."""
        if self._labels.shape != residual.shape:
            self._smooth, self._labels = _memory(residual.shape)
        # The mean of 3 x 3 pixels has a third of the noise: it connects the pixels of a faint trail.
        cv2.blur(residual, (3, 3), dst=self._smooth)
        self._labels.fill(0)
        threshold, length = self.config.trail_sigmas / 3.0, self.config.trail_length_px
        mark_trails(self._smooth, noise, mask, self._labels, threshold, length, _TRAIL)


def tile_statistics(
    image: Float32Array, counts: tuple[int, int], sides: tuple[int, int], step: int
) -> tuple[FloatArray, FloatArray]:
    """Return median and clipped standard deviation of tiles, from every ``step``-th pixel.

    Parameters
    ----------
    image : ndarray (r, c)
    counts, sides : tuple of int
        Rows and columns of the tiles; height and width of a tile, pixels.

    Returns
    -------
    medians, sigmas : ndarray of shape ``counts``
    """
    rows, cols = counts
    height, width = sides
    tiles = image[: rows * height, : cols * width].reshape(rows, height, cols, width)[:, ::step, :, ::step]
    ordered = tiles.swapaxes(1, 2).reshape(rows * cols, -1)
    ordered = np.sort(ordered, axis=1)
    medians, sigmas = ordered_statistics(ordered)
    return medians.reshape(counts), sigmas.reshape(counts)


def _memory(shape: tuple[int, ...]) -> tuple[Float32Array, NDArray[np.int32]]:
    """Return arrays for the smooth residual and for the labels of its regions."""
    return np.zeros(shape, np.float32), np.zeros(shape, np.int32)


def _without_sources(levels: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Return the levels, those of tiles that bright sources raise replaced by the median of 3 x 3 tiles."""
    median = np.asarray(cv2.medianBlur(levels.astype(np.float32), 3), dtype=np.float64)
    return np.where(levels - median > sigmas, median, levels)


def _with_border(tiles: FloatArray) -> FloatArray:
    """Return the values with one tile before and two after the image, continued linearly."""
    width = ((1, 2), (1, 2))
    if min(tiles.shape) > 2:
        return np.pad(tiles, width, mode="reflect", reflect_type="odd")
    return np.pad(tiles, width, mode="edge")
