# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The true ground under a mission: what the rovers drove over, and how true their maps of it are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import ElevationMap

#: Places along the way that are looked at, and cells under the rover, metres.
_EVERY_M, _CELL_M = 0.2, 0.05
#: Rays begin so far above the rover, metres, and find the surface of a map's cell on a grid of this many a side.
_ABOVE_M, _RAYS = 3.0, 3


@dataclass(frozen=True, slots=True)
class Driven:
    """What a robot truly drove over.

    Attributes
    ----------
    places : int
        Looked at, every 0.2 m.
    steepest_deg : float
        Largest tilt of the rover as it stood on its wheels.
    highest_m : float
        Highest surface under the rover above the plane of its wheels.
    too_steep, too_high : int
        Places beyond the limits of the profile.
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
            f"{self.robot}: drove over {self.places} places; steepest {self.steepest_deg:.1f} deg "
            f"({self.too_steep} beyond the limit), highest under it {self.highest_m:.2f} m ({self.too_high} beyond)"
        )

    def faults(self, steeper_deg: float, higher_m: float) -> list[str]:
        """Places that guidance should have kept it from: beyond its limits by more than this."""
        found = []
        if self.steepest_deg > self.max_slope_deg + steeper_deg:
            limit = f"limit {self.max_slope_deg:g} deg, tolerance {steeper_deg:g} deg"
            found.append(f"{self.robot}: drove over {self.steepest_deg:.1f} deg, {limit}")
        if self.highest_m > self.max_step_m + higher_m:
            limit = f"limit {self.max_step_m:g} m, tolerance {higher_m:g} m"
            found.append(f"{self.robot}: drove over something of {self.highest_m:.2f} m, {limit}")
        return found


@dataclass(frozen=True, slots=True)
class Mapped:
    """Heights of a map against the true ones: cells compared, mean, root mean square and NMAD of errors, metres.

    ``blank`` counts the places that were looked at and of which there is no map.
    """

    cells: int
    bias_m: float
    rms_m: float
    nmad_m: float
    blank: int = 0

    def __str__(self) -> str:
        return (
            f"elevation along the way: bias {self.bias_m:+.3f} m, RMS {self.rms_m:.3f} m, NMAD {self.nmad_m:.3f} m "
            f"over {self.cells} cells"
        )

    def faults(self, rms_m: float) -> list[str]:
        """What keeps it from being a map of the way."""
        found = [f"no elevation at {self.blank} places of the way"] if self.blank else []
        if not self.rms_m <= rms_m:
            found.append(f"{self}, expected RMS at most {rms_m:g} m")
        return found


def drop(scene: Any, points_m: FloatArray) -> FloatArray:
    """Heights ``(n,)`` of the true surface, metres, below points ``(n, 3)`` of the world; NaN where there is none."""
    import open3d as o3d

    rays = np.zeros((len(points_m), 6), dtype=np.float32)
    rays[:, :3] = points_m
    rays[:, 5] = -1.0
    fall = scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy().astype(np.float64)
    return np.where(np.isfinite(fall), points_m[:, 2] - fall, np.nan)


def driven(
    robot: str, T_world_base: FloatArray, scene: Any, base_height_m: float, limits: Mapping[str, float]
) -> Driven:
    """Look under a robot all along its true way, shape (n, 4, 4)."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(T_world_base[:, :3, 3], axis=0), axis=1))])
    rows = np.unique(np.searchsorted(s, np.arange(0.0, s[-1], _EVERY_M)).clip(max=len(s) - 1))
    x = np.arange(-0.5 * limits["length_m"], 0.5 * limits["length_m"] + 1e-9, _CELL_M)
    y = np.arange(-0.5 * limits["width_m"], 0.5 * limits["width_m"] + 1e-9, _CELL_M)
    under = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), -base_height_m)], axis=-1).reshape(-1, 3)
    steep = np.degrees(np.arccos(np.clip(T_world_base[rows, 2, 2], -1.0, 1.0)))
    highest = np.empty(len(rows))
    for i, T in enumerate(T_world_base[rows]):
        at = se3.transform_points(T, under)
        surface = drop(scene, at + np.array([0.0, 0.0, _ABOVE_M]))
        highest[i] = np.nanmax(surface - at[:, 2]) * T[2, 2]
    return Driven(
        robot, len(rows), float(steep.max()), float(highest.max()),
        int(np.sum(steep > limits["max_slope_deg"])), int(np.sum(highest > limits["max_step_m"])),
        limits["max_slope_deg"], limits["max_step_m"],
    )  # fmt: skip


def mapped(maps: list[ElevationMap], T_site_world: FloatArray, scene: Any) -> Mapped:
    """Compare each observed cell with the mean of the true surface in it."""
    errors = [np.zeros(0)]
    for made in maps:
        x, y = made.geometry.centres_m()
        seen = np.isfinite(made.layer("mean"))
        if not seen.any():
            continue
        offsets = (np.arange(_RAYS) - (_RAYS - 1) / 2) * made.geometry.resolution_m / _RAYS
        heights = made.layer("mean")[seen].astype(np.float64)
        true = np.zeros(len(heights))
        for dx in offsets:
            for dy in offsets:
                at = np.stack([x[seen] + dx, y[seen] + dy, heights + 50.0], axis=1)
                world = se3.transform_points(se3.inverse(T_site_world), at)
                true += drop(scene, world) + T_site_world[2, 3]
        errors.append(heights - true / _RAYS**2)
    error = np.concatenate(errors)
    error = error[np.isfinite(error)]
    if not len(error):
        return Mapped(0, float("nan"), float("nan"), float("nan"))
    nmad = 1.4826 * float(np.median(np.abs(error - np.median(error))))
    return Mapped(len(error), float(error.mean()), float(np.sqrt(np.mean(error**2))), nmad)
