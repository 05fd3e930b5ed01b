# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products of a robot that depend only on a seed and their number: poses, then a small map, then a cloud."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.codecs import encode
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, Pointcloud, TransformWithCovariance
from dpm_store import NewProduct

ROBOT = "mana"
_S = 1_000_000_000
#: Of the products of one cycle.
_POSES, _CELLS, _POINTS = 20, 40, 20_000


def value_of(seed: int, seq: int) -> tuple[str, Any]:
    """Return the type and the value of a product."""
    random, t_ns = np.random.default_rng((seed, seq)), seq * _S
    place = seq % (_POSES + 2)
    if place < _POSES:
        T = UncertainTransform(se3.transform(np.eye(3), random.normal(size=3)), np.eye(6) * 0.01)
        pose = TransformWithCovariance.from_transform(
            T, parent=f"{ROBOT}/odom", child=f"{ROBOT}/base", stamp_ns=t_ns
        )
        return "pose", pose
    if place == _POSES:
        geometry = GridGeometry(f"{ROBOT}/odom", 0.1, 0.0, _CELLS * 0.1, _CELLS, _CELLS)
        layers = {
            name: random.normal(size=geometry.shape).astype(np.float32)
            for name in ("mean", "variance", "min", "max", "count", "age_s")
        }
        return "dem", ElevationMap.from_layers(geometry, layers, t0_ns=t_ns, t1_ns=t_ns)
    points = random.normal(size=(_POINTS, 3))
    return "pointcloud", Pointcloud.from_points(points, frame=f"{ROBOT}/odom", stamp_ns=t_ns)


def product(seed: int, seq: int) -> NewProduct:
    """Return the product with a number."""
    kind, value = value_of(seed, seq)
    t_ns = seq * _S
    header = Header(
        product_id(ROBOT, "load", kind, t_ns, seq, "c"),
        seq,
        t_ns,
        t_ns,
        f"{ROBOT}/odom",
        "load/1",
        child=f"{ROBOT}/base" if kind == "pose" else None,
        config_hash="c",
    )
    return NewProduct(
        header,
        encode(value, "uper"),
        robot=ROBOT,
        dfpc="load",
        port=kind,
        product=kind,
        type_name=type(value).__name__,
        codec="uper",
    )
