# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Background and noise by the medians of tiles."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.star_field_background._kernels import mark_trails, tile_statistics
from cdff_core.dfns.star_field_background.interface import Inputs, Interface, Outputs

#: Smallest image, pixels, and the fraction of saturated pixels from which the image is refused.
_MIN_SIZE_PX, _MAX_SATURATED = 64, 0.5
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
        """Compile the kernels."""
        size = 2 * self.config.tile_px
        image = np.zeros((size, size), np.float32)
        tile_statistics(image, 2, 2, self.config.tile_px, self.config.tile_px, self.config.step_px)
        mark_trails(image, image + 1, np.zeros(image.shape, np.uint8), 4.0, 64.0, _TRAIL)

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
        levels, sigmas = tile_statistics(image, *counts, *sides, self.config.step_px)
        background = _interpolated(_without_sources(levels, sigmas), sides, image.shape)
        smooth = np.asarray(cv2.medianBlur(sigmas.astype(np.float32), 3), dtype=np.float64)
        noise = _interpolated(np.sqrt(smooth**2 + _ROUNDING_VARIANCE), sides, image.shape)
        residual = image - background
        # The mean of 3 x 3 pixels has a third of the noise: it connects the pixels of a faint trail.
        smooth_residual = np.asarray(cv2.blur(residual, (3, 3)), np.float32)
        mark_trails(
            smooth_residual, noise, mask, self.config.trail_sigmas / 3.0, self.config.trail_length_px, _TRAIL
        )
        return Outputs(residual=residual, noise=noise, mask=mask, saturated=saturated)


def _without_sources(levels: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Return the levels, those of tiles that bright sources raise replaced by the median of 3 x 3 tiles."""
    median = np.asarray(cv2.medianBlur(levels.astype(np.float32), 3), dtype=np.float64)
    return np.where(levels - median > sigmas, median, levels)


def _interpolated(tiles: FloatArray, sides: tuple[int, int], shape: tuple[int, ...]) -> Float32Array:
    """Return the values of the tile centres, interpolated for each pixel, and continued linearly to the
    borders.
    """
    width = ((1, 2), (1, 2))
    if min(tiles.shape) > 2:
        padded = np.pad(tiles, width, mode="reflect", reflect_type="odd")
    else:
        padded = np.pad(tiles, width, mode="edge")
    # Pixel x lies at (x + 1/2) / side - 1/2 tiles, one more with the border.
    maps = [[1.0 / sides[1], 0.0, 0.5 / sides[1] + 0.5], [0.0, 1.0 / sides[0], 0.5 / sides[0] + 0.5]]
    return np.asarray(
        cv2.warpAffine(
            padded.astype(np.float32),
            np.array(maps),
            (shape[1], shape[0]),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        ),
        np.float32,
    )
