# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How LAAS's atlaas and InFuse's DEMBuilding merge scans, as described of them: a peer to compare with.

A cell has count, least, largest and mean height, variance and the sensor's squared distance. A scan is merged cell by
cell:

- one that was seen from more than 4 m² farther than what is there is left out; one of more than 2 points from at least
  4 m² nearer takes the place of what is there;
- a cell of variance above ``VERTICAL_M2`` is vertical, else flat; a scan that finds the other kind, or a flat cell more
  than ``STEP_M`` off, takes the place of what is there;
- else counts add up, means are weighted by count, and so are the **variances**: how far the two means lie apart is
  not in what comes out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap

NEARER_M2, VERTICAL_M2, STEP_M = 4.0, 0.05, 0.1


class AtlaasMap:
    """Scans merged by these rules, in the cells of a grid."""

    def __init__(self, geometry: GridGeometry) -> None:
        self.geometry = geometry
        names = ("count", "mean", "variance", "min", "max", "distance")
        self._of = {name: np.full(geometry.shape, np.nan) for name in names}
        self._of["count"][:] = 0.0

    def merge(self, scan: ElevationMap, sensor_xy_m: NDArray[np.float64]) -> None:
        """Take one scan, whose ``variance`` is that of its heights over their number, seen from a place ``(2,)``."""
        shared = scan.geometry.intersection(self.geometry)
        if shared is None:
            return
        here, there = self.geometry.slices_of(shared), scan.geometry.slices_of(shared)
        a = {name: layer[here] for name, layer in self._of.items()}
        b = {name: scan.layer(name)[there].astype(np.float64) for name in ("count", "mean", "variance", "min", "max")}
        b["variance"] = b["variance"] * b["count"] / np.maximum(b["count"] - 1.0, 1.0)
        x, y = shared.centres_m()
        b["distance"] = (x - sensor_xy_m[0]) ** 2 + (y - sensor_xy_m[1]) ** 2
        seen, held = b["count"] > 0, a["count"] > 0
        flips = (a["variance"] > VERTICAL_M2) != (b["variance"] > VERTICAL_M2)
        steps = (a["variance"] <= VERTICAL_M2) & (np.abs(a["mean"] - b["mean"]) > STEP_M)
        nearer = (b["count"] > 2) & (a["distance"] - b["distance"] >= NEARER_M2)
        usable = seen & ~(held & (b["distance"] - a["distance"] > NEARER_M2))
        replaced = usable & (~held | nearer | flips | steps)
        joined = usable & ~replaced
        n = a["count"] + b["count"]
        with np.errstate(invalid="ignore", divide="ignore"):
            both = {name: (a["count"] * a[name] + b["count"] * b[name]) / n for name in ("mean", "variance")}
        both |= {
            "count": n, "min": np.fmin(a["min"], b["min"]), "max": np.fmax(a["max"], b["max"]),
            "distance": np.fmin(a["distance"], b["distance"]),
        }  # fmt: skip
        for name, layer in a.items():  # views of the grid
            layer[replaced], layer[joined] = b[name][replaced], both[name][joined]

    def to_map(self, stamp_ns: int) -> ElevationMap:
        """As an elevation map; without ages."""
        layers = {name: self._of[name] for name in ("mean", "variance", "min", "max", "count")}
        layers["age_s"] = np.where(self._of["count"] > 0, 0.0, np.nan)
        float32 = {name: layer.astype(np.float32) for name, layer in layers.items()}
        return ElevationMap.from_layers(self.geometry, float32, t0_ns=stamp_ns, t1_ns=stamp_ns)
