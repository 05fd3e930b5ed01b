# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuse scans by the published rules of LAAS's atlaas and InFuse's DEMBuilding, for comparison.

A cell has the count, minimum, maximum, mean and variance of its heights, and the squared distance to the
sensor. Scans are fused cell by cell:

- If the squared distance of the scan is larger by more than 4 m², the scan is ignored. If it is smaller by at
  least 4 m² and the scan has more than 2 points, the scan replaces the cell.
- A cell is vertical if its variance is above ``VERTICAL_M2``, otherwise flat. If the scan is of the other
  kind, or both are flat and differ by more than ``STEP_M``, the scan replaces the cell.
- Otherwise counts are added, and means and variances are averaged with the counts as weights. The variance
  therefore does not contain the difference of the means.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap

NEARER_M2, VERTICAL_M2, STEP_M = 4.0, 0.05, 0.1


class AtlaasMap:
    """An elevation map that fuses scans by these rules."""

    def __init__(self, geometry: GridGeometry) -> None:
        self.geometry = geometry
        names = ("count", "mean", "variance", "min", "max", "distance")
        self._layers = {name: np.full(geometry.shape, np.nan) for name in names}
        self._layers["count"][:] = 0.0

    def merge(self, scan: ElevationMap, sensor_xy_m: NDArray[np.float64]) -> None:
        """Fuse one scan, recorded at the sensor position ``(2,)``; ``variance`` is divided by ``count``."""
        shared = scan.geometry.intersection(self.geometry)
        if shared is None:
            return
        map_slices, scan_slices = self.geometry.slices_of(shared), scan.geometry.slices_of(shared)
        a = {name: layer[map_slices] for name, layer in self._layers.items()}
        b = {
            name: scan.layer(name)[scan_slices].astype(np.float64)
            for name in ("count", "mean", "variance", "min", "max")
        }
        b["variance"] = b["variance"] * b["count"] / np.maximum(b["count"] - 1.0, 1.0)
        x, y = shared.centres_m()
        b["distance"] = (x - sensor_xy_m[0]) ** 2 + (y - sensor_xy_m[1]) ** 2
        in_scan, in_map = b["count"] > 0, a["count"] > 0
        kinds_differ = (a["variance"] > VERTICAL_M2) != (b["variance"] > VERTICAL_M2)
        differs_by_a_step = (a["variance"] <= VERTICAL_M2) & (np.abs(a["mean"] - b["mean"]) > STEP_M)
        is_nearer = (b["count"] > 2) & (a["distance"] - b["distance"] >= NEARER_M2)
        usable = in_scan & ~(in_map & (b["distance"] - a["distance"] > NEARER_M2))
        replaced = usable & (~in_map | is_nearer | kinds_differ | differs_by_a_step)
        averaged = usable & ~replaced
        n = a["count"] + b["count"]
        with np.errstate(invalid="ignore", divide="ignore"):
            fused = {name: (a["count"] * a[name] + b["count"] * b[name]) / n for name in ("mean", "variance")}
        fused |= {
            "count": n,
            "min": np.fmin(a["min"], b["min"]),
            "max": np.fmax(a["max"], b["max"]),
            "distance": np.fmin(a["distance"], b["distance"]),
        }
        for name, layer in a.items():  # the layers are views of the map
            layer[replaced], layer[averaged] = b[name][replaced], fused[name][averaged]

    def to_map(self, stamp_ns: int) -> ElevationMap:
        """Return the elevation map; all ages are 0."""
        layers = {name: self._layers[name] for name in ("mean", "variance", "min", "max", "count")}
        layers["age_s"] = np.where(self._layers["count"] > 0, 0.0, np.nan)
        float32 = {name: layer.astype(np.float32) for name, layer in layers.items()}
        return ElevationMap.from_layers(self.geometry, float32, t0_ns=stamp_ns, t1_ns=stamp_ns)
