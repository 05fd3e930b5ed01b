# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation patches and clouds to put into a store, with the points they were made from."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.codecs import encode
from cdff_common.codecs.siblings import wire_type
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap, Pointcloud
from dpm_store import Parcel, Store

S = 1_000_000_000


def parcel_of(value: Any, product: str, seq: int, robot: str = "mana", **fields: Any) -> Parcel:
    """A value captured at ``seq`` seconds."""
    t_ns = fields.pop("t1_ns", seq * S)
    header = Header(
        id=product_id(robot, "test", product, t_ns, seq, "c"), seq=seq, t0_ns=t_ns, t1_ns=t_ns, frame=value.frame,
        producer="test", config_hash="c", box_m=value.extent_m(), **fields,
    )  # fmt: skip
    return Parcel(header, encode(value, "uper"), robot, "test", product, product, wire_type(value), "uper", value)


def put_value(store: Store, value: Any, product: str, seq: int, robot: str = "mana", **fields: Any) -> str:
    """Insert a value captured at ``seq`` seconds; returns its id."""
    parcel = parcel_of(value, product, seq, robot, **fields)
    store.put_all([parcel])
    return parcel.header.id


def ground(x: Any, y: Any) -> Any:
    """Height of the terrain at points, metres."""
    return 0.4 * np.sin(0.7 * x) + 0.3 * np.cos(0.5 * y) + 0.05 * x


def patch(
    rng: np.random.Generator, bounds: tuple[float, float, float, float], seq: int, *, cell_m: float = 0.1,
    n: int = 3000, frame: str = "site", lift_m: float = 0.0,
) -> tuple[ElevationMap, np.ndarray]:  # fmt: skip
    """A patch of the terrain, and its points."""
    x, y = rng.uniform(bounds[0], bounds[2], n), rng.uniform(bounds[1], bounds[3], n)
    points = np.column_stack([x, y, ground(x, y) + lift_m + rng.normal(0.0, 0.01, n)])
    geometry = GridGeometry.aligned(frame, cell_m, bounds)
    cells = CellStatistics.from_points(geometry, points, stamps_ns=seq * S)
    return ElevationMap.from_layers(geometry, cells.to_layers(seq * S), t0_ns=seq * S, t1_ns=seq * S), points


def put_patch(
    store: Store, rng: np.random.Generator, bounds: tuple[float, float, float, float], seq: int, robot: str = "mana",
    **fields: Any,
) -> tuple[str, np.ndarray]:  # fmt: skip
    """Insert a patch; returns its id and points."""
    value, points = patch(rng, bounds, seq, **fields)
    return put_value(store, value, "dem", seq, robot, resolution_m=value.geometry.resolution_m), points


def put_known_patch(
    store: Store, rng: np.random.Generator, bounds: tuple[float, float, float, float], seq: int, robot: str = "mana",
    *, overhang_m: float | None = None,
) -> ElevationMap:  # fmt: skip
    """Insert a patch with the layers that ``digital_elevation_mapping`` gives beyond the six; returns it."""
    value, _ = patch(rng, bounds, seq)
    seen = np.isfinite(value.layer("mean"))
    known = {"pose_variance": 0.01 * seq, "intensity": 10.0 * seq, "first_age_s": 0.5}
    if overhang_m is not None:
        known["overhang_m"] = overhang_m
    layers = {name: value.layer(name) for name in value.layer_names}
    layers["variance"] = layers["variance"] + np.float32(known["pose_variance"])
    layers |= {name: np.where(seen, v, np.nan).astype(np.float32) for name, v in known.items()}
    made = ElevationMap.from_layers(value.geometry, layers, t0_ns=value.t0_ns, t1_ns=value.t1_ns)
    put_value(store, made, "dem", seq, robot, resolution_m=made.geometry.resolution_m)
    return made


def put_cloud(store: Store, points: Any, seq: int, frame: str = "site", **fields: Any) -> str:
    """Insert a cloud; returns its id."""
    value = Pointcloud.from_points(points, frame=frame, stamp_ns=seq * S, intensity=fields.pop("intensity", None))
    return put_value(store, value, "pointcloud", seq, **fields)
