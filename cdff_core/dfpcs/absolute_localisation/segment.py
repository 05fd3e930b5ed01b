# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Segment of the path: the map since the last match."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_common.raster import ELEVATION_LAYERS, GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs

#: Greatest number of patches listed as inputs.
_MAX_INPUTS = 256


class Segment:
    """Patches fused into one map by a new DemFusion, from the path length ``start_m`` on."""

    def __init__(self, fusion: Dfn[Any, Any, Any], start_m: float) -> None:
        self._fusion, self._start_m = fusion, start_m
        self.map: ElevationMap | None = None
        self.patch: Sample | None = None
        self.inputs: tuple[str, ...] = ()
        self.t0_ns: int | None = None
        self.length_m = 0.0

    def add(self, sample: Sample, path_length_m: float | None) -> None:
        """Fuse a patch; raises InputError if it does not fit the map.

        Without ``path_length_m`` the length of the segment is the extent of its map.
        """
        patch = with_statistics(sample.value)
        self.map = self._fusion.process(DemFusionInputs(patch=patch)).map
        if path_length_m is None and extent_m(patch) > extent_m(self.map):
            self.map = patch  # the patch is a whole map, larger than the window of a segment
        self.patch = sample
        self.inputs = (*self.inputs, sample.id)[-_MAX_INPUTS:] if sample.id else self.inputs
        self.t0_ns = min(self.t0_ns or sample.value.t0_ns, sample.value.t0_ns)
        if path_length_m is None:
            self.length_m = max(self.length_m, extent_m(self.map))
        else:
            self.length_m = path_length_m - self._start_m


def with_statistics(elevation: ElevationMap) -> ElevationMap:
    """Return the map with the layers of cell statistics; without them, each cell is one measurement."""
    if set(ELEVATION_LAYERS) <= set(elevation.layer_names):
        return elevation
    z = elevation.layer("mean").astype(np.float32)
    one, none = (np.where(np.isfinite(z), value, np.nan) for value in (1.0, 0.0))
    layers = {"mean": z, "variance": none, "min": z, "max": z, "count": one, "age_s": none}
    return ElevationMap.from_layers(
        elevation.geometry,
        {name: layer.astype(np.float32) for name, layer in layers.items()},
        t0_ns=elevation.t0_ns,
        t1_ns=elevation.t1_ns,
    )


def shift_cells(
    T_orbital_map: FloatArray, rover: GridGeometry, orbital: GridGeometry, point: FloatArray
) -> tuple[float, float]:
    """Return columns and rows to add to the indices of the rover map's cells to reach the orbital map's.

    With a rotation or different cell sizes, these numbers are those of the cell at ``point`` (3,) of the
    rover map.
    """
    orbital_x_m, orbital_y_m, _ = T_orbital_map[:3, :3] @ point + T_orbital_map[:3, 3]
    rover_x_m, rover_y_m, _ = point
    columns = (orbital_x_m - orbital.xmin_m) / orbital.resolution_m
    columns -= (rover_x_m - rover.xmin_m) / rover.resolution_m
    rows = (orbital.ymax_m - orbital_y_m) / orbital.resolution_m
    rows -= (rover.ymax_m - rover_y_m) / rover.resolution_m
    return float(columns), float(rows)


def centre(elevation: ElevationMap) -> FloatArray:
    """Return the mean position (3,) of the observed cells."""
    z = elevation.layer("mean")
    row, col = np.nonzero(np.isfinite(z))
    g = elevation.geometry
    if not len(row):
        return np.zeros(3)
    return np.array(
        [g.x_centres_m()[col].mean(), g.y_centres_m()[row].mean(), float(z[row, col].mean(dtype=np.float64))]
    )


def extent_m(elevation: ElevationMap) -> float:
    """Return the longest extent of the observed cells, metres."""
    row, col = np.nonzero(np.isfinite(elevation.layer("mean")))
    if not len(row):
        return 0.0
    return float(max(np.ptp(row), np.ptp(col)) + 1) * elevation.geometry.resolution_m
