# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Slope and roughness of the plane under the footprint, steps around each cell, and classes."""

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
from cdff_core.dfns.traversability._uncertainty import denoised, footprint_noise, step_loss_by_denoising
from cdff_core.dfns.traversability.interface import Inputs, Interface, Outputs

UNKNOWN, SAFE, CAUTION, HAZARD = 0, 1, 2, 3
#: A step inside a cell appears in the difference of its two neighbours: heights are compared over two cells.
_LEAST_REACH_CELLS = 2

#: Lower bound of the standard deviation of a margin, in the unit of its measure.
_LEAST_SIGMA = 1e-6
#: Minimum observed fraction of the footprint.
_MIN_OBSERVED = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class _Measure:
    """Values ``(rows, cols)`` and their standard deviations."""

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
            "Height of the rover; lower overhangs (layer overhang_m of the map) are hazards; absent: "
            "overhangs are not assessed"
        ),
    )
    max_slope_deg: float = Field(20.0, gt=0, lt=90, description="Steepest slope that the rover can stand on")
    max_step_m: float = Field(0.2, gt=0, le=10, description="Highest step that the rover can take")
    max_roughness_m: float = Field(
        0.1, gt=0, le=10, description="Largest root mean square distance from the plane of the footprint"
    )
    step_reach_m: float = Field(
        0.2, gt=0, le=10, description="Distance over which heights are compared; at least one cell"
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
        0.7, gt=0, le=1, description="Fraction of a limit from which a cell is caution"
    )
    sigmas: float = Field(
        3.0,
        ge=0,
        le=10,
        description="Number of standard deviations by which safe terrain is below each limit",
    )
    correlated_m: float = Field(0.0, ge=0, le=10, description="Distance of correlated errors of heights")


class FootprintPlane(Interface[FootprintPlaneConfig]):
    """Class of each cell for a rover with its middle on the cell and any heading.

    Slope and roughness are those of the least-squares plane of the observed cells in the square of the
    rover's longer side, so they need no inflation; steps are those of single cells and are inflated. An
    unobserved cell, or one with too little observed under the rover, is unknown. Where the elevation map has
    variances, safe terrain keeps every limit by a number of standard deviations, and a step that may be too
    high is caution within the rover's radius. Terrain under an overhang lower than the rover's height plus
    the same number of standard deviations is a hazard.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        fit_planes(np.zeros((3, 3)), 1, 3)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the navigation map of the same cells; raises InputError without the layer mean."""
        c, dem = self.config, inputs.dem
        cell_m = dem.geometry.resolution_m
        z = dem.layer("mean").astype(np.float64)
        seen = np.isfinite(z)
        datum = np.median(z[seen]) if seen.any() else 0.0
        z -= datum  # sums of squares far from zero lose digits
        variance = np.zeros_like(z)
        if "variance" in dem.layer_names:
            variance = np.nan_to_num(dem.layer("variance").astype(np.float64), nan=0.0)
        slope, roughness = self._planes(z, seen, variance, cell_m)
        step, step_loss_m = self._steps(z, seen, variance, cell_m)
        room = self._clearance(dem, z + datum, variance)
        measures = [(slope, c.max_slope_deg), (roughness, c.max_roughness_m), (step, c.max_step_m)]
        ratio, bound = (
            np.fmax.reduce([(m.value + k * m.sigma) / limit for m, limit in measures])
            for k in (0.0, c.sigmas)
        )
        known = seen & np.isfinite(slope.value)
        blocked = room.value < c.sigmas * room.sigma  # false where NaN
        classes = self._classify(
            known, ratio, bound, step, step_loss_m, blocked, cell_m, _gaps(seen, c.gap_m, cell_m)
        )
        margins = [(limit - m.value, m.sigma) for m, limit in measures] + [(room.value, room.sigma)]
        margin = np.fmin.reduce([left / np.maximum(sigma, _LEAST_SIGMA) for left, sigma in margins])
        layers = {
            "slope_deg": slope.value,
            "step_m": step.value,
            "roughness_m": roughness.value,
            "cost": np.where(classes == HAZARD, 1.0, np.clip(ratio, 0.0, 1.0)),
            "confidence": ndtr(margin),
        }
        rated = classes != UNKNOWN
        made = NavigationMap.from_layers(
            dem.geometry,
            {"class": classes}
            | {name: np.where(rated, a, np.nan).astype(np.float32) for name, a in layers.items()},
            t0_ns=dem.t0_ns,
            t1_ns=dem.t1_ns,
        )
        return Outputs(map=made)

    def _clearance(self, dem: ElevationMap, z: FloatArray, variance: FloatArray) -> _Measure:
        """Return the clearance below overhangs, NaN without one or where it is not assessed."""
        if self.config.height_m is None or "overhang_m" not in dem.layer_names:
            return _Measure(np.full(z.shape, np.nan), np.zeros(z.shape))
        return _Measure(dem.layer("overhang_m") - z - self.config.height_m, np.sqrt(variance))

    def _planes(
        self, z: FloatArray, seen: BoolArray, variance: FloatArray, cell_m: float
    ) -> tuple[_Measure, _Measure]:
        """Return slope and roughness under the footprint, NaN where too little is observed."""
        c = self.config
        half = max(1, round(0.5 * max(c.length_m, c.width_m) / cell_m))
        least = max(3, round(_MIN_OBSERVED * (2 * half + 1) ** 2))
        rise_per_cell, rms, _, _ = fit_planes(np.where(seen, z, np.nan), half, least)
        noise, count = footprint_noise(variance, seen, half)
        # Correlated heights within some cells count once; half (half + 1) / 3 is their mean square offset.
        independent = np.maximum(count, 1.0) / max(1.0, c.correlated_m / cell_m) ** 2
        sigma = np.sqrt(noise / (independent * half * (half + 1) / 3.0))
        tangent = rise_per_cell / cell_m
        angle_per_tangent = 1.0 / (1.0 + tangent**2)  # d(atan t)/dt
        slope = _Measure(np.degrees(np.arctan(tangent)), np.degrees(sigma / cell_m * angle_per_tangent))
        return slope, _Measure(rms, np.sqrt(0.5 * noise / independent))

    def _steps(
        self, z: FloatArray, seen: BoolArray, variance: FloatArray, cell_m: float
    ) -> tuple[_Measure, FloatArray]:
        """Return the largest difference of a cell to observed ones within reach, NaN where unobserved.

        The second result is the height, metres, that denoising removes from a step as high as ``max_step_m``.
        """
        reach = max(_LEAST_REACH_CELLS, round(self.config.step_reach_m / cell_m))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        z, variance, noise = denoised(z, seen, variance)
        far = np.finfo(np.float32).max / 4
        highest = cv2.dilate(
            np.where(seen, z, -far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE
        )
        lowest = cv2.erode(np.where(seen, z, far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE)
        worst = cv2.dilate(
            np.where(seen, variance, 0.0).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE
        )
        value = np.where(seen, np.maximum(highest - z, z - lowest), np.nan)
        return _Measure(value, np.sqrt(variance + worst)), step_loss_by_denoising(
            noise, self.config.max_step_m
        )

    def _classify(
        self,
        known: BoolArray,
        ratio: FloatArray,
        bound: FloatArray,
        step: _Measure,
        step_loss_m: FloatArray,
        blocked: BoolArray,
        cell_m: float,
        gaps: BoolArray,
    ) -> ByteArray:
        c = self.config
        obstacle = (step.value + step_loss_m > c.max_step_m) | blocked  # false where NaN
        possible = obstacle | (step.value + c.sigmas * step.sigma > c.max_step_m)
        safe = (ratio < c.caution_fraction) & (bound <= 1.0)
        classes = np.where(known, np.where(safe, SAFE, CAUTION), UNKNOWN).astype(np.uint8)
        turning_m = 0.5 * hypot(c.length_m, c.width_m) + c.margin_m
        passing_m = 0.5 * min(c.length_m, c.width_m) + c.margin_m
        classes[known & (_distance_m(possible, cell_m) <= turning_m)] = CAUTION
        classes[known & (_distance_m(gaps, cell_m) <= passing_m)] = CAUTION
        classes[known & (_distance_m(obstacle, cell_m) <= passing_m)] = HAZARD
        classes[known & (ratio > 1.0)] = HAZARD
        classes[obstacle] = HAZARD  # a hazard even where too little around it is observed
        return classes


def _gaps(seen: BoolArray, gap_m: float, cell_m: float) -> BoolArray:
    """Return the unobserved cells of holes of at least that width; the map's border counts as observed."""
    cells = (
        2 * max(0, round(0.5 * (gap_m / cell_m - 1.0))) + 1
    )  # odd, since an even opening shifts its result
    disc = cv2.getStructuringElement(cv2.MORPH_RECT, (cells, cells))
    hidden = cv2.morphologyEx((~seen).astype(np.uint8), cv2.MORPH_OPEN, disc, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(hidden > 0)


def _distance_m(cells: BoolArray, cell_m: float) -> Float32Array:
    """Return the distance of every cell from the nearest of the given ones; infinite where there are none."""
    if not cells.any():
        return np.full(cells.shape, np.inf, np.float32)
    free = np.where(cells, 0, 255).astype(np.uint8)
    return np.asarray(cell_m * cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))
