# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Slope and roughness of the plane under the footprint, steps around each cell, classes with inflation in metres."""

from __future__ import annotations

from math import hypot
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import NavigationMap
from cdff_core.dfns.traversability._interface import (
    TraversabilityInputs,
    TraversabilityInterface,
    TraversabilityOutputs,
)
from cdff_core.dfns.traversability._kernels import fit_planes

UNKNOWN, SAFE, CAUTION, HAZARD = 0, 1, 2, 3
#: A step that lies inside a cell shows in the difference of its two neighbours: heights are compared over two cells.
_LEAST_REACH_CELLS = 2

FloatGrid = NDArray[np.float64]


class FootprintPlaneConfig(DfnConfig):
    """Size and limits of the rover."""

    length_m: float = Field(1.0, gt=0.0, le=20.0, description="Length of the rover, metres")
    width_m: float = Field(0.8, gt=0.0, le=20.0, description="Width of the rover, metres")
    max_slope_deg: float = Field(20.0, gt=0.0, lt=90.0, description="Steepest slope, degrees")
    max_step_m: float = Field(0.2, gt=0.0, le=10.0, description="Highest step, metres")
    max_roughness_m: float = Field(0.1, gt=0.0, le=10.0, description="Largest rms distance from the plane, metres")
    step_reach_m: float = Field(0.2, gt=0.0, le=10.0, description="Distance over which heights are compared, metres")
    margin_m: float = Field(0.1, ge=0.0, le=10.0, description="Added to the rover's radius around steps, metres")
    caution_fraction: float = Field(0.7, gt=0.0, le=1.0, description="Share of a limit from which a cell is caution")
    min_observed_fraction: float = Field(0.5, gt=0.0, le=1.0, description="Share of the footprint to be observed")


class FootprintPlane(TraversabilityInterface):
    """A cell's class says whether the rover may stand with its middle there, whatever its heading.

    Slope and roughness come from the least-squares plane of the observed cells in the square of the rover's longer
    side, so they need no inflation; steps are those of single cells and are inflated. An unobserved cell, or one with
    too little observed under the rover, is unknown.
    """

    Config: ClassVar[type[DfnConfig]] = FootprintPlaneConfig

    def setup(self) -> None:
        """Compile, so that the first map is as fast as the others."""
        fit_planes(np.zeros((3, 3)), 1, 3)

    def process(self, inputs: TraversabilityInputs) -> TraversabilityOutputs:
        """Return the navigation map of the same cells; raises InputError if the elevation map has no layer mean."""
        c, geometry = self.config, inputs.dem.geometry
        z = inputs.dem.layer("mean").astype(np.float64)
        seen = np.isfinite(z)
        z -= np.median(z[seen]) if seen.any() else 0.0  # sums of squares far from zero lose digits
        slope_deg, roughness_m = self._planes(z, geometry.resolution_m)
        step_m = self._steps(z, seen, geometry.resolution_m)
        known = seen & np.isfinite(slope_deg)
        ratio = np.fmax(np.fmax(slope_deg / c.max_slope_deg, roughness_m / c.max_roughness_m), step_m / c.max_step_m)
        classes = self._classify(known, ratio, step_m, geometry.resolution_m)
        rated = classes != UNKNOWN
        cost = np.where(classes == HAZARD, 1.0, np.clip(ratio, 0.0, 1.0))
        layers = {"class": classes.astype(np.uint8)}
        for name, layer in (("slope_deg", slope_deg), ("step_m", step_m), ("roughness_m", roughness_m), ("cost", cost)):
            layers[name] = np.where(rated, layer, np.nan).astype(np.float32)
        made = NavigationMap.from_layers(geometry, layers, t0_ns=inputs.dem.t0_ns, t1_ns=inputs.dem.t1_ns)
        return TraversabilityOutputs(map=made)

    def _planes(self, z: FloatGrid, resolution_m: float) -> tuple[FloatGrid, FloatGrid]:
        half = max(1, round(0.5 * max(self.config.length_m, self.config.width_m) / resolution_m))
        least = max(3, round(self.config.min_observed_fraction * (2 * half + 1) ** 2))
        gradient, rms = fit_planes(z, half, least)
        return np.degrees(np.arctan(gradient / resolution_m)), rms

    def _steps(self, z: FloatGrid, seen: NDArray[np.bool_], resolution_m: float) -> FloatGrid:
        """Largest difference between a cell and the observed ones within reach; NaN where the cell is unobserved."""
        reach = max(_LEAST_REACH_CELLS, round(self.config.step_reach_m / resolution_m))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        far = np.finfo(np.float32).max / 4
        highest = cv2.dilate(np.where(seen, z, -far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE)
        lowest = cv2.erode(np.where(seen, z, far).astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE)
        return np.where(seen, np.maximum(highest - z, z - lowest), np.nan)

    def _classify(
        self, known: NDArray[np.bool_], ratio: FloatGrid, step_m: FloatGrid, resolution_m: float
    ) -> NDArray[np.int64]:
        c = self.config
        obstacle = step_m > c.max_step_m  # false where NaN
        classes = np.where(known, np.where(ratio >= c.caution_fraction, CAUTION, SAFE), UNKNOWN)
        if obstacle.any():
            clear = np.where(obstacle, 0, 255).astype(np.uint8)
            distance_m = resolution_m * cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            turning_m, passing_m = 0.5 * hypot(c.length_m, c.width_m), 0.5 * min(c.length_m, c.width_m)
            classes[known & (distance_m <= turning_m + c.margin_m)] = CAUTION
            classes[known & (distance_m <= passing_m + c.margin_m)] = HAZARD
        classes[known & (ratio > 1.0)] = HAZARD
        classes[obstacle] = HAZARD  # seen to be one, even where too little around it is observed
        return classes
