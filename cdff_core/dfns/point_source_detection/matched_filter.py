# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection by the matched filter."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_source_detection._kernels import local_maxima, measure_regions
from cdff_core.dfns.point_source_detection.interface import Inputs, Interface, Outputs
from cdff_core.point_sources.regions import AREA, FIRST_U, LAST_V, MEAN_U, MEAN_V, UU, VV

#: Value of the mask in trails of satellites and cosmic rays.
_TRAIL = 2
#: Number of widths of the point spread after which its image is cut off.
_CUT_OFF_SIGMAS = 3.5


class MatchedFilterConfig(DfnConfig):
    """Parameters of MatchedFilter."""

    min_snr: float = Field(
        4.0, ge=2.0, le=100.0, description="Ratio of signal to noise from which a maximum is a source"
    )
    bright_snr: float = Field(
        10.0,
        ge=4.0,
        le=1e3,
        description="Ratio of signal to noise from which the extent of a source is measured",
    )
    region_sigmas: float = Field(
        3.0, ge=1.5, le=20.0, description="Brightness of the pixels of a region, standard deviations"
    )
    max_sources: int = Field(
        2000, ge=10, le=100_000, description="Number of maxima above which the image is refused"
    )


class MatchedFilter(Interface[MatchedFilterConfig]):
    """Correlation with the image of a point, which maximises the ratio of signal to white noise [1]_.

    References
    ----------
    .. [1] Turin, G. L. (1960). An introduction to matched filters. IRE Transactions on Information
       Theory 6(3).
      doi:10.1109/TIT.1960.1057571
    """

    def setup(self) -> None:
        """Compile the kernels; allocate the memory that every image uses again."""
        image = np.zeros((8, 8), np.float32)
        self._labels = np.zeros((0, 0), np.int32)
        pixels, snr, _ = local_maxima(image, image + 1, 4.0, 1.0, 10)
        measure_regions(
            image, image + 1, image.astype(np.uint8), pixels, snr, 5.0, 3.0, np.zeros((8, 8), np.int32)
        )

    def process(self, inputs: Inputs) -> Outputs:
        """Return the sources of an image, brightest first.

        Raises
        ------
        InputError
            If the point spread is not positive definite.
        RefusedError
            If the image holds more maxima than the limit.
        """
        residual = np.ascontiguousarray(inputs.residual, np.float32)
        noise = np.ascontiguousarray(inputs.noise, np.float32)
        filtered, gain = _correlate(residual, inputs.point_spread)
        limit = self.config.max_sources
        pixels, snr, count = local_maxima(filtered, noise, self.config.min_snr, gain, limit)
        if count > limit:
            raise RefusedError(
                f"image: {count} sources, expected at most {limit}; no star field, or its noise is not white",
                reasons=[f"many_sources:{count}>{limit}"],
            )
        order = np.argsort(-snr, kind="stable")
        pixels, snr = pixels[order], snr[order]
        points = _refine_maxima(filtered, pixels)
        if self._labels.shape == residual.shape:
            self._labels.fill(0)
        else:
            self._labels = np.zeros(residual.shape, np.int32)
        regions, owner = measure_regions(
            residual,
            noise,
            inputs.mask,
            pixels,
            snr,
            self.config.bright_snr,
            self.config.region_sigmas,
            self._labels,
        )
        is_extended = self._is_extended(regions, snr, inputs.point_spread)
        # A second maximum in the region of a point-like source is a source of its own. In the region of an
        # extended source it is a part of this source.
        is_kept = (owner == np.arange(len(owner))) | ~is_extended[owner]
        points[is_extended] = regions[is_extended][:, [MEAN_U, MEAN_V]]
        is_trail = inputs.mask[pixels[:, 0], pixels[:, 1]] == _TRAIL
        return Outputs(
            points=points[is_kept],
            snr=snr[is_kept],
            areas=regions[is_kept, AREA].astype(np.int64),
            boxes=regions[is_kept, FIRST_U : LAST_V + 1],
            moments=regions[is_kept, UU : VV + 1],
            is_extended=is_extended[is_kept],
            is_trail=is_trail[is_kept],
        )

    def _is_extended(self, regions: FloatArray, snr: FloatArray, point_spread: FloatArray) -> np.ndarray:
        """Return which regions are larger than the image of a point of their brightness.

        The region of a Gaussian of peak p and limit t has the area 2 pi s^2 ln(p / t). Lenses scatter more
        light than a Gaussian has in its wings, hence the factor; a saturated star has a larger region still,
        but its light is concentrated, unlike that of a body.
        """
        area = 2.0 * np.pi * np.sqrt(np.linalg.det(point_spread))
        peak = snr / np.sqrt(4.0 * np.pi * np.sqrt(np.linalg.det(point_spread)))
        expected = area * np.log(np.maximum(peak / self.config.region_sigmas, 1.5)) + 4.0
        return np.asarray(regions[:, AREA] > 2.5 * expected)


def _correlate(residual: Float32Array, point_spread: FloatArray) -> tuple[Float32Array, float]:
    """Return the image correlated with the point spread, and the noise of the result for a noise of one."""
    spread = np.asarray(point_spread, dtype=float)
    if not (np.all(np.linalg.eigvalsh(spread) > 0.0) and np.allclose(spread, spread.T)):
        raise InputError(f"pointSpread {spread.tolist()}: expected a positive definite matrix")
    if abs(spread[0, 1]) < 1e-9:
        kernels = [_gaussian(spread[i, i]) for i in range(2)]
        filtered = cv2.sepFilter2D(
            residual, cv2.CV_32F, kernels[0], kernels[1], borderType=cv2.BORDER_REFLECT
        )
        return np.asarray(filtered, np.float32), float(
            np.linalg.norm(kernels[0]) * np.linalg.norm(kernels[1])
        )
    kernel = _gaussian_2d(spread)
    filtered = cv2.filter2D(residual, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(filtered, np.float32), float(np.linalg.norm(kernel))


def _gaussian(variance: float) -> Float32Array:
    reach = max(int(np.ceil(_CUT_OFF_SIGMAS * np.sqrt(variance))), 1)
    x = np.arange(-reach, reach + 1)
    kernel = np.exp(-0.5 * x * x / (variance + 1.0 / 12.0))  # the pixel adds its own variance
    return np.asarray(kernel / kernel.sum(), np.float32)


def _gaussian_2d(spread: FloatArray) -> Float32Array:
    reach = max(int(np.ceil(_CUT_OFF_SIGMAS * np.sqrt(np.linalg.eigvalsh(spread)[-1]))), 1)
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    information = np.linalg.inv(spread + np.eye(2) / 12.0)
    square = information[0, 0] * u * u + 2.0 * information[0, 1] * u * v + information[1, 1] * v * v
    kernel = np.exp(-0.5 * square)
    return np.asarray(kernel / kernel.sum(), np.float32)


def _refine_maxima(filtered: Float32Array, pixels: np.ndarray) -> FloatArray:
    """Return column and row of the maxima of parabolas through the neighbours of each maximum."""
    r, c = pixels[:, 0], pixels[:, 1]
    centre = filtered[r, c].astype(float)
    offsets = []
    for before, after in ((filtered[r, c - 1], filtered[r, c + 1]), (filtered[r - 1, c], filtered[r + 1, c])):
        curvature = 2.0 * centre - before - after
        step = np.divide(0.5 * (after - before), curvature, out=np.zeros_like(centre), where=curvature > 0)
        offsets.append(np.clip(step, -0.5, 0.5))
    return np.column_stack([c + offsets[0], r + offsets[1]])
