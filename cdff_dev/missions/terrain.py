# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison with the true terrain: slopes and steps along the paths, and errors of elevation maps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import ElevationMap
from cdff_dev.missions.tracks import path_lengths_m

#: Spacing of the assessed positions along the path, and of the points under the rover, metres.
_EVERY_M, _CELL_M = 0.2, 0.05
#: Height of the origins of the rays above the wheels, metres; number of rays along each edge of a map cell.
_ABOVE_M, _RAYS = 3.0, 3


@dataclass(frozen=True, slots=True)
class TerrainCrossed:
    """True terrain along the path of a robot.

    Attributes
    ----------
    places : int
        Number of assessed positions, one every 0.2 m.
    steepest_deg : float
        Largest tilt of the rover on its wheels.
    highest_m : float
        Largest height of the surface under the rover above the plane of its wheels.
    too_steep, too_high : int
        Numbers of positions at which the limits of the profile are exceeded.
    max_slope_deg, max_step_m : float
        These limits.
    """

    robot: str
    places: int
    steepest_deg: float
    highest_m: float
    too_steep: int
    too_high: int
    max_slope_deg: float
    max_step_m: float

    def __str__(self) -> str:
        return (
            f"{self.robot}: {self.places} positions of the path assessed; steepest "
            f"{self.steepest_deg:.1f} deg ({self.too_steep} beyond the limit), highest obstacle under the "
            f"rover {self.highest_m:.2f} m "
            f"({self.too_high} beyond)"
        )

    def faults(self, slope_excess_deg: float, step_excess_m: float) -> list[str]:
        """Return the limits that the terrain exceeds by more than the given excess."""
        faults = []
        if self.steepest_deg > self.max_slope_deg + slope_excess_deg:
            limit = f"limit {self.max_slope_deg:g} deg, tolerance {slope_excess_deg:g} deg"
            faults.append(f"{self.robot}: drove over {self.steepest_deg:.1f} deg, {limit}")
        if self.highest_m > self.max_step_m + step_excess_m:
            limit = f"limit {self.max_step_m:g} m, tolerance {step_excess_m:g} m"
            faults.append(f"{self.robot}: drove over an obstacle of {self.highest_m:.2f} m, {limit}")
        return faults


@dataclass(frozen=True, slots=True)
class MapErrors:
    """Errors of elevation maps: number of compared cells; mean, RMS and NMAD of their errors, metres.

    ``blank`` is the number of positions without a map.
    """

    cells: int
    bias_m: float
    rms_m: float
    nmad_m: float
    blank: int = 0

    def __str__(self) -> str:
        return (
            f"elevation along the path: bias {self.bias_m:+.3f} m, RMS {self.rms_m:.3f} m, NMAD "
            f"{self.nmad_m:.3f} m over {self.cells} cells"
        )

    def faults(self, rms_m: float) -> list[str]:
        """Return the faults of the elevation along the path."""
        faults = [f"no elevation at {self.blank} poses of the path"] if self.blank else []
        if not self.rms_m <= rms_m:
            faults.append(f"{self}, expected RMS at most {rms_m:g} m")
        return faults


def surface_heights_m(scene: Any, points_m: FloatArray) -> FloatArray:
    """Return the heights ``(n,)`` of the true surface below points ``(n, 3)`` in the world.

    The height is NaN where there is no surface.
    """
    import open3d as o3d

    rays = np.zeros((len(points_m), 6), dtype=np.float32)
    rays[:, :3] = points_m
    rays[:, 5] = -1.0
    distance_m = (
        scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)["t_hit"].numpy().astype(np.float64)
    )
    return np.where(np.isfinite(distance_m), points_m[:, 2] - distance_m, np.nan)


def assess_crossed_terrain(
    robot: str, T_world_base: FloatArray, scene: Any, base_height_m: float, limits: Mapping[str, float]
) -> TerrainCrossed:
    """Assess the terrain under a robot along its true path, shape (n, 4, 4)."""
    s = path_lengths_m(T_world_base[:, :3, 3])
    rows = np.unique(np.searchsorted(s, np.arange(0.0, s[-1], _EVERY_M)).clip(max=len(s) - 1))
    x = np.arange(-0.5 * limits["length_m"], 0.5 * limits["length_m"] + 1e-9, _CELL_M)
    y = np.arange(-0.5 * limits["width_m"], 0.5 * limits["width_m"] + 1e-9, _CELL_M)
    under = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), -base_height_m)], axis=-1).reshape(-1, 3)
    tilt_deg = np.degrees(np.arccos(np.clip(T_world_base[rows, 2, 2], -1.0, 1.0)))
    highest = np.empty(len(rows))
    for i, T in enumerate(T_world_base[rows]):
        points = se3.transform_points(T, under)
        surface_m = surface_heights_m(scene, points + np.array([0.0, 0.0, _ABOVE_M]))
        highest[i] = np.nanmax(surface_m - points[:, 2]) * T[2, 2]
    return TerrainCrossed(
        robot,
        len(rows),
        float(tilt_deg.max()),
        float(highest.max()),
        int(np.sum(tilt_deg > limits["max_slope_deg"])),
        int(np.sum(highest > limits["max_step_m"])),
        limits["max_slope_deg"],
        limits["max_step_m"],
    )


def compare_elevation(maps: list[ElevationMap], T_site_world: FloatArray, scene: Any) -> MapErrors:
    """Compare each observed cell of maps in the site frame with the mean of the true surface in the cell."""
    errors = [np.zeros(0)]
    for elevation in maps:
        x, y = elevation.geometry.centres_m()
        observed = np.isfinite(elevation.layer("mean"))
        if not observed.any():
            continue
        offsets = (np.arange(_RAYS) - (_RAYS - 1) / 2) * elevation.geometry.resolution_m / _RAYS
        heights = elevation.layer("mean")[observed].astype(np.float64)
        true_sum = np.zeros(len(heights))
        for dx in offsets:
            for dy in offsets:
                above = np.stack([x[observed] + dx, y[observed] + dy, heights + 50.0], axis=1)
                above_world = se3.transform_points(se3.inverse(T_site_world), above)
                true_sum += surface_heights_m(scene, above_world) + T_site_world[2, 3]
        errors.append(heights - true_sum / _RAYS**2)
    error = np.concatenate(errors)
    error = error[np.isfinite(error)]
    if not len(error):
        return MapErrors(0, float("nan"), float("nan"), float("nan"))
    nmad = 1.4826 * float(np.median(np.abs(error - np.median(error))))
    return MapErrors(len(error), float(error.mean()), float(np.sqrt(np.mean(error**2))), nmad)
