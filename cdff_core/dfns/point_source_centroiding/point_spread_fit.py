# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Centroids by a least-squares fit of the point spread."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_source_centroiding.interface import Inputs, Interface, Outputs
from cdff_core.point_sources.point_spread import fit_all

#: Number of widths of the point spread in half a window.
_WINDOW_SIGMAS = 3.0
#: Relative excess of the variance over the bound, times the square of the ratio of signal to noise.
_SECOND_ORDER = 8.0
#: Smallest width of a point spread, pixels, that differs from a single bright pixel.
_MIN_SIGMA_PX = 0.45


class PointSpreadFitConfig(DfnConfig):
    """Parameters of PointSpreadFit."""

    shape_snr: float = Field(
        20.0,
        ge=5.0,
        le=1e4,
        description="Ratio of signal to noise from which the shape of a source is fitted",
    )
    shape_sources: int = Field(
        16, ge=1, le=1000, description="Largest number of sources whose shape is fitted"
    )
    floor_px: float = Field(
        0.02,
        ge=0.0,
        le=1.0,
        description="Error of a centroid without noise, by the difference of point spread and Gaussian, px",
    )
    relative_error: float = Field(
        0.02,
        ge=0.0,
        le=1.0,
        description="Error of the model of the point spread relative to the light of a pixel",
    )
    single_pixel_margin: float = Field(
        9.0,
        ge=0.0,
        le=1e6,
        description="Difference of squared residuals by which a single pixel must fit better than a point",
    )


class PointSpreadFit(Interface[PointSpreadFitConfig]):
    """Fit of a Gaussian that is integrated over each pixel: in white noise the maximum-likelihood estimate,
    whose
    variance approaches the Cramér–Rao bound [1]_.

    The covariance is that bound, multiplied by the mean squared residual where that is larger than one,
    plus a
    floor for errors of the model.

    References
    ----------
    .. [1] Winick, K. A. (1986). Cramér–Rao lower bounds on the performance of charge-coupled-device
       optical position
      estimators. Journal of the Optical Society of America A 3(11). doi:10.1364/JOSAA.3.001809
    """

    def setup(self) -> None:
        """Compile the kernel."""
        image = np.zeros((16, 16), np.float32)
        fit_all(image, image + 1, np.full((1, 2), 8.0), np.eye(2), 4, False)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the centroids with covariance.

        Raises
        ------
        InputError
            If the point spread is not positive definite.
        """
        spread = np.ascontiguousarray(inputs.point_spread, float)
        eigenvalues = np.linalg.eigvalsh(spread)
        if not eigenvalues[0] > 0.0:
            raise InputError(f"pointSpread {spread.tolist()}: expected a positive definite matrix")
        residual = np.ascontiguousarray(inputs.residual, np.float32)
        noise = np.ascontiguousarray(inputs.noise, np.float32)
        points = np.ascontiguousarray(inputs.points, float)
        reach = max(int(np.ceil(_WINDOW_SIGMAS * np.sqrt(eigenvalues[-1]))), 2)
        fits = fit_all(residual, noise, points, spread, reach, False)
        has_converged = fits[:, 12] > 0.0
        with np.errstate(invalid="ignore"):
            snr = np.where(has_converged, fits[:, 2] / fits[:, 7], np.nan)
        spreads = np.full((len(points), 3), np.nan)
        # The points are sorted by brightness: of many bright stars, those in the middle are neither
        # saturated nor faint.
        bright = np.flatnonzero(snr > self.config.shape_snr)
        if len(bright) > self.config.shape_sources:
            first = (len(bright) - self.config.shape_sources) // 2
            bright = bright[first : first + self.config.shape_sources]
        if len(bright):
            free = fit_all(residual, noise, fits[bright, :2].copy(), spread, reach + 1, True)
            ok = free[:, 12] > 0.0
            spreads[bright[ok]] = free[ok, 9:12]
        covariances = self._covariances(fits, snr, reach)
        is_single = np.zeros(len(points), bool)
        if np.sqrt(eigenvalues[0]) > _MIN_SIGMA_PX:
            # Where the model of the point spread is wrong by a part of the light, bright stars do not fit
            # either.
            margin = self.config.single_pixel_margin + (self.config.relative_error * snr) ** 2
            is_single = ~has_converged | (fits[:, 8] > margin)
        centroids = np.where(has_converged[:, None], fits[:, :2], np.nan)
        return Outputs(
            centroids=centroids,
            covariances=covariances,
            fluxes=np.where(has_converged, fits[:, 2], np.nan),
            snr=snr,
            misfit=fits[:, 3],
            is_single_pixel=is_single,
            defect_evidence=fits[:, 8],
            spreads=spreads,
        )

    def _covariances(self, fits: np.ndarray, snr: np.ndarray, reach: int) -> np.ndarray:
        """Return the covariances (n, 2, 2) of the positions, enlarged by residuals that exceed the noise."""
        covariances = np.empty((len(fits), 2, 2))
        covariances[:, 0, 0], covariances[:, 1, 1] = fits[:, 4], fits[:, 6]
        covariances[:, 0, 1] = covariances[:, 1, 0] = fits[:, 5]
        # The mean of k squared normal residuals has the standard deviation sqrt(2 / k).
        count = (2 * reach + 1) ** 2 - 3
        excess = np.maximum(fits[:, 3] / (1.0 + 3.0 * np.sqrt(2.0 / count)), 1.0)
        # Second order of the bound: at low signal, the error of the maximum-likelihood estimate exceeds the
        # bound. The excess is that of simulated sources with signal-to-noise ratios of 5 to 20.
        excess = excess * (1.0 + _SECOND_ORDER / np.maximum(snr, 1.0) ** 2)
        covariances *= excess[:, None, None]
        return np.asarray(covariances + self.config.floor_px**2 * np.eye(2))
