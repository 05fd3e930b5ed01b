# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products that a test inserts into a real DPM."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap

#: Start of the test, to which ages refer.
NOW_NS = wall_ns()

T_SITE_BASE = UncertainTransform(se3.transform(se3.exp_so3([0, 0, 0.3]), [1.0, 2.0, 0.1]), np.eye(6) * 1e-4)


def put(
    bus: Bus, product: str, value: Any, robot: str = "mana", child: str | None = None, seq: int = 0
) -> Header:
    """Insert a value over the bus; return its header."""
    frame = value.parent_frame if hasattr(value, "parent_frame") else value.frame
    resolution_m = value.geometry.resolution_m if hasattr(value, "geometry") else None
    header = Header(
        product_id(robot, "producer", product, value.stamp_ns, seq, ""),
        seq,
        value.stamp_ns,
        value.stamp_ns,
        frame,
        "producer/P/1",
        child=child,
        box_m=value.extent_m(),
        resolution_m=resolution_m,
    )
    name = type(value).__name__
    bus.call(
        keys.dpm_rpc("ground", "put"),
        {"robot": robot, "dfpc": "producer", "port": product, "product": product},
        payload=encode(value, "uper"),
        encoding=encoding_string(name, "uper"),
        attachment=header.to_attachment(),
        timeout_s=20,
    )
    return header


def patch(xmin_m: float, height_m: float, age_s: float, cells: int = 40) -> ElevationMap:
    """Return a square patch of 5 cm cells with its lower edge on y = 0."""
    geometry = GridGeometry.from_cells(
        "site", 0.05, left=round(xmin_m / 0.05), top=cells, rows=cells, cols=cells
    )
    ones = np.full(geometry.shape, 1.0, np.float32)
    values = {"mean": height_m, "variance": 0.01, "min": height_m, "max": height_m, "count": 4, "age_s": 0}
    layers = {name: ones * value for name, value in values.items()}
    t_ns = NOW_NS - int(age_s * 1e9) // 1000 * 1000
    return ElevationMap.from_layers(geometry, layers, t0_ns=t_ns, t1_ns=t_ns)
