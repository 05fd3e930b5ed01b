# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Slope and roughness of the plane under the footprint, steps around each cell, classes with inflation in metres."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.special import ndtr

from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import ElevationMap, NavigationMap
from cdff_core.dfns.traversability._interface import (
    TraversabilityInputs,
    TraversabilityInterface,
    TraversabilityOutputs,
)
from cdff_core.dfns.traversability._kernels import fit_planes
from cdff_core.dfns.traversability._uncertainty import denoised, footprint_noise, taken_from_steps

UNKNOWN, SAFE, CAUTION, HAZARD = 0, 1, 2, 3
#: A step that lies inside a cell shows in the difference of its two neighbours: heights are compared over two cells.
_LEAST_REACH_CELLS = 2

#: Standard deviation at which a margin is as good as certain, in the unit of its measure.
_LEAST_SIGMA = 1e-6

FloatGrid = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class _Measure:
    """Values ``(rows, cols)`` and their standard deviations."""

    value: FloatGrid
    sigma: FloatGrid


class FootprintPlaneConfig(DfnConfig):
    """Size and limits of the rover."""

    length_m: float = Field(1.0, gt=0.0, le=20.0, description="Length of the rover, metres")
    width_m: float = Field(0.8, gt=0.0, le=20.0, description="Width of the rover, metres")
    height_m: float | None = Field(
        None, gt=0.0, le=20.0, description="Height of the rover, metres; absent: what hangs over ground is not judged"
    )
    max_slope_deg: float = Field(20.0, gt=0.0, lt=90.0, description="Steepest slope, degrees")
    max_step_m: float = Field(0.2, gt=0.0, le=10.0, description="Highest step, metres")
    max_roughness_m: float = Field(0.1, gt=0.0, le=10.0, description="Largest rms distance from the plane, metres")
    step_reach_m: float = Field(0.2, gt=0.0, le=10.0, description="Distance over which heights are compared, metres")
    gap_m: float = Field(0.25, ge=0.0, le=10.0, description="Unobserved ground this wide may hide a step, metres")
    margin_m: float = Field(0.1, ge=0.0, le=10.0, description="Added to the rover's radius around steps, metres")
    caution_fraction: float = Field(0.7, gt=0.0, le=1.0, description="Share of a limit from which a cell is caution")
    sigmas: float = Field(3.0, ge=0.0, le=10.0, description="Standard deviations by which safe ground keeps its limits")
    correlated_m: float = Field(
        0.0, ge=0.0, le=10.0, description="Distance over which errors of heights are alike, metres"
    )
    min_observed_fraction: float = Field(0.5, gt=0.0, le=1.0, description="Share of the footprint to be observed")


class FootprintPlane(TraversabilityInterface):
    """A cell's class says whether the rover may stand with its middle there, whatever its heading.

    Slope and roughness come from the least-squares plane of the observed cells in the square of the rover's longer
    side, so they need no inflation; steps are those of single cells and are inflated. An unobserved cell, or one with
    too little observed under the rover, is unknown. Where the elevation map states variances, safe ground keeps every
    limit by so many standard deviations, and a step that may be too high is caution as far as the rover turns. Ground
    that something hangs over lower than the rover's height and so many standard deviations is a hazard as a step is.
    """

    Config: ClassVar[type[DfnConfig]] = FootprintPlaneConfig

    def setup(self) -> None:
        """Compile, so that the first map is as fast as the others."""
        fit_planes(np.zeros((3, 3)), 1, 3)

    def process(self, inputs: TraversabilityInputs) -> TraversabilityOutputs:
        """Return the navigation map of the same cells; raises InputError if the elevation map has no layer mean."""
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
        step, taken_m = self._steps(z, seen, variance, cell_m)
        room = self._room(dem, z + datum, variance)
        measures = [(slope, c.max_slope_deg), (roughness, c.max_roughness_m), (step, c.max_step_m)]
        ratio, bound = (
            np.fmax.reduce([(m.value + k * m.sigma) / limit for m, limit in measures]) for k in (0.0, c.sigmas)
        )
        known = seen & np.isfinite(slope.value)
        blocked = room.value < c.sigmas * room.sigma  # false where NaN
        classes = self._classify(known, ratio, bound, step, taken_m, blocked, cell_m, _gaps(seen, c.gap_m, cell_m))
        margins = [(limit - m.value, m.sigma) for m, limit in measures] + [(room.value, room.sigma)]
        margin = np.fmin.reduce([left / np.maximum(sigma, _LEAST_SIGMA) for left, sigma in margins])
        layers = {
            "slope_deg": slope.value, "step_m": step.value, "roughness_m": roughness.value,
            "cost": np.where(classes == HAZARD, 1.0, np.clip(ratio, 0.0, 1.0)), "confidence": ndtr(margin),
        }  # fmt: skip
        rated = classes != UNKNOWN
        made = NavigationMap.from_layers(
            dem.geometry,
            {"class": classes} | {name: np.where(rated, a, np.nan).astype(np.float32) for name, a in layers.items()},
            t0_ns=dem.t0_ns, t1_ns=dem.t1_ns,
        )  # fmt: skip
        return TraversabilityOutputs(map=made)

    def _room(self, dem: ElevationMap, z: FloatGrid, variance: FloatGrid) -> _Measure:
        """Height left between the rover's top and what hangs over it, NaN where nothing does or it is not judged."""
        if self.config.height_m is None or "overhang_m" not in dem.layer_names:
            return _Measure(np.full(z.shape, np.nan), np.zeros(z.shape))
        return _Measure(dem.layer("overhang_m") - z - self.config.height_m, np.sqrt(variance))

    def _planes(self, z: FloatGrid, seen: Mask, variance: FloatGrid, cell_m: float) -> tuple[_Measure, _Measure]:
        """Slope and roughness under the footprint, NaN where too little is observed."""
        c = self.config
        half = max(1, round(0.5 * max(c.length_m, c.width_m) / cell_m))
        least = max(3, round(c.min_observed_fraction * (2 * half + 1) ** 2))
        gradient, rms, _, _ = fit_planes(np.where(seen, z, np.nan), half, least)
        noise, count = footprint_noise(variance, seen, half)
        # Of heights alike within some cells one counts; half (half + 1) / 3 is their mean square offset.
        independent = np.maximum(count, 1.0) / max(1.0, c.correlated_m / cell_m) ** 2
        sigma = np.sqrt(noise / (independent * half * (half + 1) / 3.0))
        flatter = 1.0 / (1.0 + (gradient / cell_m) ** 2)  # an angle grows by so much less than its tangent
        slope = _Measure(np.degrees(np.arctan(gradient / cell_m)), np.degrees(sigma / cell_m * flatter))
        return slope, _Measure(rms, np.sqrt(0.5 * noise / independent))

    def _steps(self, z: FloatGrid, seen: Mask, variance: FloatGrid, cell_m: float) -> tuple[_Measure, FloatGrid]:
        """Largest difference between a cell and the observed ones within reach, NaN where the cell is unobserved.

        Beside it what denoising takes from a step of the limit's height, metres.
        """
        reach = max(_LEAST_REACH_CELLS, round(self.config.step_reach_m / cell_m))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        z, variance, noise = denoised(z, seen, variance)
        far = np.finfo(np.float32).max / 4
        highest = cv2.dilate(np.where(seen, z, -far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE)
        lowest = cv2.erode(np.where(seen, z, far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE)
        worst = cv2.dilate(np.where(seen, variance, 0.0).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE)
        value = np.where(seen, np.maximum(highest - z, z - lowest), np.nan)
        return _Measure(value, np.sqrt(variance + worst)), taken_from_steps(noise, self.config.max_step_m)

    def _classify(
        self,
        known: Mask,
        ratio: FloatGrid,
        bound: FloatGrid,
        step: _Measure,
        taken_m: FloatGrid,
        blocked: Mask,
        cell_m: float,
        gaps: Mask,
    ) -> NDArray[np.uint8]:
        c = self.config
        obstacle = (step.value + taken_m > c.max_step_m) | blocked  # false where NaN
        possible = obstacle | (step.value + c.sigmas * step.sigma > c.max_step_m)
        safe = (ratio < c.caution_fraction) & (bound <= 1.0)
        classes = np.where(known, np.where(safe, SAFE, CAUTION), UNKNOWN).astype(np.uint8)
        turning_m = 0.5 * hypot(c.length_m, c.width_m) + c.margin_m
        passing_m = 0.5 * min(c.length_m, c.width_m) + c.margin_m
        classes[known & (_distance_m(possible, cell_m) <= turning_m)] = CAUTION
        classes[known & (_distance_m(gaps, cell_m) <= passing_m)] = CAUTION
        classes[known & (_distance_m(obstacle, cell_m) <= passing_m)] = HAZARD
        classes[known & (ratio > 1.0)] = HAZARD
        classes[obstacle] = HAZARD  # seen to be one, even where too little around it is observed
        return classes


def _gaps(seen: Mask, gap_m: float, cell_m: float) -> Mask:
    """Unobserved cells of holes at least that wide; the map's edge counts as observed."""
    cells = 2 * max(0, round(0.5 * (gap_m / cell_m - 1.0))) + 1  # odd: an even opening would move what it keeps
    disc = cv2.getStructuringElement(cv2.MORPH_RECT, (cells, cells))
    hidden = cv2.morphologyEx((~seen).astype(np.uint8), cv2.MORPH_OPEN, disc, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(hidden > 0)


def _distance_m(cells: Mask, cell_m: float) -> NDArray[np.float32]:
    """Distance of every cell from the nearest of those; infinite where there are none."""
    if not cells.any():
        return np.full(cells.shape, np.inf, np.float32)
    free = np.where(cells, 0, 255).astype(np.uint8)
    return np.asarray(cell_m * cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))
