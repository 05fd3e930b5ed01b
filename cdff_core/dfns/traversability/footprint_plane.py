# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Traversability from slope and roughness under the footprint and from steps around each cell."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import cv2
import numpy as np
from pydantic import Field
from scipy.special import ndtr

from cdff_common.arrays import BoolArray, ByteArray, Float32Array, FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import ElevationMap, NavigationMap
from cdff_core.dfns.traversability._kernels import fit_planes
from cdff_core.dfns.traversability._uncertainty import denoise, footprint_noise, step_loss_by_denoising
from cdff_core.dfns.traversability.interface import Inputs, Interface, Outputs

UNKNOWN, SAFE, CAUTION, HAZARD = 0, 1, 2, 3
#: A step inside a cell appears in the difference of its two neighbours, so heights are compared over two
#: cells.
_MIN_REACH_CELLS = 2
#: Lower bound of the standard deviation of a margin, in the unit of its measure.
_MIN_SIGMA = 1e-6
#: Minimum observed fraction of the footprint.
_MIN_OBSERVED = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class _Measure:
    """Values of a quantity in each cell ``(rows, cols)``, and their standard deviations."""

    value: FloatArray
    sigma: FloatArray


class FootprintPlaneConfig(DfnConfig):
    """Parameters of FootprintPlane: size and limits of the rover."""

    length_m: float = Field(1.0, gt=0, le=20, description="Length of the rover")
    width_m: float = Field(0.8, gt=0, le=20, description="Width of the rover")
    height_m: float | None = Field(
        None,
        gt=0,
        le=20,
        description=(
            "Height of the rover; lower overhangs (layer overhang_m of the map) are hazards; if absent, "
            "overhangs are not assessed"
        ),
    )
    max_slope_deg: float = Field(20.0, gt=0, lt=90, description="Largest slope on which the rover can stand")
    max_step_m: float = Field(0.2, gt=0, le=10, description="Highest step that the rover can take")
    max_roughness_m: float = Field(
        0.1, gt=0, le=10, description="Largest root mean square distance from the plane of the footprint"
    )
    step_reach_m: float = Field(
        0.2, gt=0, le=10, description="Distance over which heights are compared, at least two cells"
    )
    gap_m: float = Field(
        0.25,
        ge=0,
        le=10,
        description=(
            "Width of unobserved terrain that may hide a step; terrain within half the rover's width of "
            "it is not safe"
        ),
    )
    margin_m: float = Field(0.1, ge=0, le=10, description="Margin added to the rover's radius around steps")
    caution_fraction: float = Field(
        0.7, gt=0, le=1, description="Fraction of a limit above which a cell is caution"
    )
    sigmas: float = Field(
        3.0,
        ge=0,
        le=10,
        description="Number of standard deviations by which safe terrain must be below each limit",
    )
    correlated_m: float = Field(
        0.0, ge=0, le=10, description="Distance over which errors of heights are correlated"
    )


class FootprintPlane(Interface[FootprintPlaneConfig]):
    """Classify each cell for a rover with its middle on the cell and any heading.

    Slope and roughness are those of the least-squares plane of the observed cells in a square with the
    rover's longer side, so they need no inflation; steps are those of single cells and are inflated. A cell
    is unknown if it is unobserved, or if too little of the footprint is observed. If the elevation map has
    variances, safe terrain is below every limit by a number of standard deviations, and cells within the
    rover's radius of a step that may be too high are caution. Terrain under an overhang lower than the
    rover's height plus the same number of standard deviations is a hazard.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        fit_planes(np.zeros((3, 3)), 1, 3)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the navigation map of the same cells; raises InputError without the layer mean."""
        c, dem = self.config, inputs.dem
        cell_m = dem.geometry.resolution_m
        z = dem.layer("mean").astype(np.float64)
        observed = np.isfinite(z)
        datum = np.median(z[observed]) if observed.any() else 0.0
        z -= datum  # the sums of squares of large heights would lose digits
        variance = np.zeros_like(z)
        if "variance" in dem.layer_names:
            variance = np.nan_to_num(dem.layer("variance").astype(np.float64), nan=0.0)
        slope, roughness = self._slope_and_roughness(z, observed, variance, cell_m)
        step, step_loss_m = self._steps(z, observed, variance, cell_m)
        clearance = self._clearance(dem, z + datum, variance)
        measures = [(slope, c.max_slope_deg), (roughness, c.max_roughness_m), (step, c.max_step_m)]
        ratio, upper_ratio = (
            np.fmax.reduce([(m.value + k * m.sigma) / limit for m, limit in measures])
            for k in (0.0, c.sigmas)
        )
        known = observed & np.isfinite(slope.value)
        classes = self._classify(
            known=known,
            ratio=ratio,
            upper_ratio=upper_ratio,
            step=step,
            step_loss_m=step_loss_m,
            is_blocked=clearance.value < c.sigmas * clearance.sigma,  # false where NaN
            gaps=_gaps(observed, c.gap_m, cell_m),
            cell_m=cell_m,
        )
        margins = [(limit - m.value, m.sigma) for m, limit in measures]
        margins.append((clearance.value, clearance.sigma))
        margin_sigmas = np.fmin.reduce([margin / np.maximum(sigma, _MIN_SIGMA) for margin, sigma in margins])
        layers = {
            "slope_deg": slope.value,
            "step_m": step.value,
            "roughness_m": roughness.value,
            "cost": np.where(classes == HAZARD, 1.0, np.clip(ratio, 0.0, 1.0)),
            "confidence": ndtr(margin_sigmas),
        }
        is_rated = classes != UNKNOWN
        navigation_map = NavigationMap.from_layers(
            dem.geometry,
            {"class": classes}
            | {
                name: np.where(is_rated, values, np.nan).astype(np.float32) for name, values in layers.items()
            },
            t0_ns=dem.t0_ns,
            t1_ns=dem.t1_ns,
        )
        return Outputs(map=navigation_map)

    def _clearance(self, dem: ElevationMap, z: FloatArray, variance: FloatArray) -> _Measure:
        """Return the clearance of the rover below overhangs; NaN if there is none or it is not assessed."""
        if self.config.height_m is None or "overhang_m" not in dem.layer_names:
            return _Measure(np.full(z.shape, np.nan), np.zeros(z.shape))
        return _Measure(dem.layer("overhang_m") - z - self.config.height_m, np.sqrt(variance))

    def _slope_and_roughness(
        self, z: FloatArray, observed: BoolArray, variance: FloatArray, cell_m: float
    ) -> tuple[_Measure, _Measure]:
        """Return slope (degrees) and roughness (metres) under the footprint, NaN where too little is
        observed.
        """
        c = self.config
        half = max(1, round(0.5 * max(c.length_m, c.width_m) / cell_m))
        min_cells = max(3, round(_MIN_OBSERVED * (2 * half + 1) ** 2))
        rise_per_cell, rms, _, _ = fit_planes(np.where(observed, z, np.nan), half, min_cells)
        noise, count = footprint_noise(variance, observed, half)
        # Heights with correlated errors count once; half (half + 1) / 3 is the mean square offset of the
        # cells.
        independent = np.maximum(count, 1.0) / max(1.0, c.correlated_m / cell_m) ** 2
        sigma = np.sqrt(noise / (independent * half * (half + 1) / 3.0))
        tangent = rise_per_cell / cell_m
        angle_per_tangent = 1.0 / (1.0 + tangent**2)  # d(atan t)/dt
        slope = _Measure(np.degrees(np.arctan(tangent)), np.degrees(sigma / cell_m * angle_per_tangent))
        return slope, _Measure(rms, np.sqrt(0.5 * noise / independent))

    def _steps(
        self, z: FloatArray, observed: BoolArray, variance: FloatArray, cell_m: float
    ) -> tuple[_Measure, FloatArray]:
        """Return the largest height difference of a cell to observed cells within reach, NaN where
        unobserved.

        The second result is the height, metres, that denoising removes from a step of ``max_step_m``.
        """
        reach = max(_MIN_REACH_CELLS, round(self.config.step_reach_m / cell_m))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        z, variance, noise = denoise(z, observed, variance)
        far = np.finfo(np.float32).max / 4
        highest = cv2.dilate(
            np.where(observed, z, -far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE
        )
        lowest = cv2.erode(
            np.where(observed, z, far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE
        )
        max_variance = cv2.dilate(
            np.where(observed, variance, 0.0).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE
        )
        value = np.where(observed, np.maximum(highest - z, z - lowest), np.nan)
        return _Measure(value, np.sqrt(variance + max_variance)), step_loss_by_denoising(
            noise, self.config.max_step_m
        )

    def _classify(
        self,
        *,
        known: BoolArray,
        ratio: FloatArray,
        upper_ratio: FloatArray,
        step: _Measure,
        step_loss_m: FloatArray,
        is_blocked: BoolArray,
        gaps: BoolArray,
        cell_m: float,
    ) -> ByteArray:
        """Return the class of each cell.

        ``ratio`` is the largest ratio of a value to its limit, ``upper_ratio`` the same with the configured
        number of standard deviations added; ``is_blocked`` are cells below a low overhang, ``gaps``
        unobserved cells that may hide a step.
        """
        c = self.config
        obstacle = (step.value + step_loss_m > c.max_step_m) | is_blocked  # false where NaN
        possible_obstacle = obstacle | (step.value + c.sigmas * step.sigma > c.max_step_m)
        safe = (ratio < c.caution_fraction) & (upper_ratio <= 1.0)
        classes = np.where(known, np.where(safe, SAFE, CAUTION), UNKNOWN).astype(np.uint8)
        turning_m = 0.5 * hypot(c.length_m, c.width_m) + c.margin_m
        passing_m = 0.5 * min(c.length_m, c.width_m) + c.margin_m
        classes[known & (_distance_m(possible_obstacle, cell_m) <= turning_m)] = CAUTION
        classes[known & (_distance_m(gaps, cell_m) <= passing_m)] = CAUTION
        classes[known & (_distance_m(obstacle, cell_m) <= passing_m)] = HAZARD
        classes[known & (ratio > 1.0)] = HAZARD
        classes[obstacle] = HAZARD  # even if too little of the footprint is observed
        return classes


def _gaps(observed: BoolArray, gap_m: float, cell_m: float) -> BoolArray:
    """Return the unobserved cells of holes at least ``gap_m`` wide; outside the map counts as observed."""
    # Odd, since an opening by an even number of cells shifts the result.
    cells = 2 * max(0, round(0.5 * (gap_m / cell_m - 1.0))) + 1
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (cells, cells))
    wide_holes = cv2.morphologyEx(
        (~observed).astype(np.uint8), cv2.MORPH_OPEN, square, borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(wide_holes > 0)


def _distance_m(cells: BoolArray, cell_m: float) -> Float32Array:
    """Return the distance of every cell from the nearest of the given cells; infinite if none is given."""
    if not cells.any():
        return np.full(cells.shape, np.inf, np.float32)
    outside = np.where(cells, 0, 255).astype(np.uint8)
    return np.asarray(cell_m * cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))
