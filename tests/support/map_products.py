# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation patches of a known terrain and point clouds, to insert into a store."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.codecs import encode
from cdff_common.codecs.wire_types import wire_type
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap, Pointcloud
from dpm_store import NewProduct, Store

#: Nanoseconds in a second.
S = 1_000_000_000


def new_product_of(value: Any, product: str, seq: int, robot: str = "mana", **fields: Any) -> NewProduct:
    """Return a product to insert, captured at ``seq`` seconds unless ``t1_ns`` is given."""
    t1_ns = fields.pop("t1_ns", seq * S)
    header = Header(
        id=product_id(robot, "test", product, t1_ns, seq, "c"),
        seq=seq,
        t0_ns=t1_ns,
        t1_ns=t1_ns,
        frame=value.frame,
        producer="test",
        config_hash="c",
        box_m=value.extent_m(),
        **fields,
    )
    return NewProduct(
        header, encode(value, "uper"), robot, "test", product, product, wire_type(value), "uper", value
    )


def put_value(store: Store, value: Any, product: str, seq: int, robot: str = "mana", **fields: Any) -> str:
    """Insert a value captured at ``seq`` seconds; return its id."""
    new_product = new_product_of(value, product, seq, robot, **fields)
    store.put_all([new_product])
    return new_product.header.id


def ground(x: Any, y: Any) -> Any:
    """Return the terrain height at points, m."""
    return 0.4 * np.sin(0.7 * x) + 0.3 * np.cos(0.5 * y) + 0.05 * x


def patch(
    rng: np.random.Generator,
    bounds: tuple[float, float, float, float],
    seq: int,
    *,
    cell_m: float = 0.1,
    n: int = 3000,
    frame: str = "site",
    offset_m: float = 0.0,
) -> tuple[ElevationMap, np.ndarray]:
    """Return a patch of the terrain, raised by ``offset_m``, and the points that it was made from."""
    x, y = rng.uniform(bounds[0], bounds[2], n), rng.uniform(bounds[1], bounds[3], n)
    points = np.column_stack([x, y, ground(x, y) + offset_m + rng.normal(0.0, 0.01, n)])
    geometry = GridGeometry.aligned(frame, cell_m, bounds)
    cells = CellStatistics.from_points(geometry, points, stamps_ns=seq * S)
    return ElevationMap.from_layers(geometry, cells.to_layers(seq * S), t0_ns=seq * S, t1_ns=seq * S), points


def put_patch(
    store: Store,
    rng: np.random.Generator,
    bounds: tuple[float, float, float, float],
    seq: int,
    robot: str = "mana",
    **fields: Any,
) -> tuple[str, np.ndarray]:
    """Insert a patch; return its id and the points that it was made from."""
    value, points = patch(rng, bounds, seq, **fields)
    return put_value(store, value, "dem", seq, robot, resolution_m=value.geometry.resolution_m), points


def put_patch_with_all_layers(
    store: Store,
    rng: np.random.Generator,
    bounds: tuple[float, float, float, float],
    seq: int,
    robot: str = "mana",
    *,
    overhang_m: float | None = None,
    offset_m: float = 0.0,
) -> ElevationMap:
    """Insert and return a patch with the six required layers and the optional ones."""
    value, _ = patch(rng, bounds, seq, offset_m=offset_m)
    observed = np.isfinite(value.layer("mean"))
    extra_layers = {"pose_variance": 0.01 * seq, "intensity": 10.0 * seq, "first_age_s": 0.5}
    if overhang_m is not None:
        extra_layers["overhang_m"] = overhang_m
    layers = {name: value.layer(name) for name in value.layer_names}
    layers["variance"] = layers["variance"] + np.float32(extra_layers["pose_variance"])
    layers |= {name: np.where(observed, v, np.nan).astype(np.float32) for name, v in extra_layers.items()}
    dem = ElevationMap.from_layers(value.geometry, layers, t0_ns=value.t0_ns, t1_ns=value.t1_ns)
    put_value(store, dem, "dem", seq, robot, resolution_m=dem.geometry.resolution_m)
    return dem


def put_cloud(store: Store, points: Any, seq: int, frame: str = "site", **fields: Any) -> str:
    """Insert a cloud; return its id."""
    value = Pointcloud.from_points(
        points, frame=frame, stamp_ns=seq * S, intensity=fields.pop("intensity", None)
    )
    return put_value(store, value, "pointcloud", seq, **fields)
