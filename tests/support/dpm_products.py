# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products of each type in the form that is sent to the DPM."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cdff_common.codecs import encode, encoding_string
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import (
    ElevationMap,
    NavigationMap,
    ObjectTrack,
    Pointcloud,
    TransformWithCovariance,
)

#: Nanoseconds in a second.
S = 1_000_000_000

#: Arguments of ``StoreWriter.put``: names, payload, encoding, attachment.
PutArguments = tuple[dict[str, str], bytes, str, bytes]


def elevation(
    x0: float,
    height_m: float = 0.0,
    t1_ns: int = 0,
    *,
    cells: int = 20,
    resolution_m: float = 0.1,
    frame: str = "site",
) -> ElevationMap:
    """Return a flat square patch with its lower left corner at (x0, 0) m."""
    geometry = GridGeometry(frame, resolution_m, x0, cells * resolution_m, cells, cells)
    ones = np.ones(geometry.shape, dtype=np.float32)
    layers = {
        "mean": ones * height_m,
        "variance": ones * 0.01,
        "min": ones * (height_m - 0.1),
        "max": ones * (height_m + 0.1),
        "count": ones * 2,
        "age_s": ones * 0,
    }
    return ElevationMap.from_layers(geometry, layers, t0_ns=t1_ns, t1_ns=t1_ns)


def navigation() -> NavigationMap:
    """Return a navigation map with one half safe and one half hazard."""
    geometry = GridGeometry("site", 0.1, 0.0, 1.0, 10, 10)
    classes = np.ones(geometry.shape, dtype=np.uint8)
    classes[:, 5:] = 3
    return NavigationMap.from_layers(geometry, {"class": classes}, t0_ns=0, t1_ns=0)


def cloud(n: int = 300) -> Pointcloud:
    """Return a cloud of normally distributed points with a standard deviation of 2 m."""
    return Pointcloud.from_points(np.random.default_rng(0).normal(0, 2, (n, 3)), frame="site", stamp_ns=S)


def pose(second: int, x: float) -> TransformWithCovariance:
    """Return the pose of ``mana/base`` at ``(x, 0, 0)`` m in ``site``."""
    T = UncertainTransform(se3.transform(np.eye(3), [x, 0, 0]), np.eye(6) * 0.01)
    return TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=second * S)


def bearing_track(
    second: int, azimuth_rad: float, range_m: float = float("nan"), track_id: int = 1
) -> ObjectTrack:
    """Return the state of an object in the frame ``inertial``; the range has an error of a tenth of it."""
    return ObjectTrack.from_bearing(
        track_id,
        second * S,
        frame="inertial",
        bearing=[azimuth_rad, 0.1, 1e-4, 1e-4, range_m, 0.1 * range_m],
        position_m=np.full(3, np.nan),
        position_covariance=np.full((3, 3), np.nan),
        velocity=np.zeros(3),
        pixel=[10.0, 20.0],
        pixel_sigma=[0.1, 0.1],
        label="target",
    )


def pose_track(
    seconds: Sequence[int], positions_m: Sequence[Sequence[float]], frame: str, track_id: int = 1
) -> ObjectTrack:
    """Return the track of an object with variances of its position of 0.04, 0.09 and 0.04 m2."""
    matrices = [se3.transform(np.eye(3), position_m) for position_m in positions_m]
    covariance = np.diag([0.04, 0.09, 0.04, 0.01, 0.01, 0.01])
    return ObjectTrack.from_arrays(
        track_id,
        [second * S for second in seconds],
        matrices,
        frame=frame,
        label="boulder",
        status=1,
        covariances=[covariance] * len(matrices),
    )


def put_arguments(
    value: Any, product: str, seq: int = 0, robot: str = "mana", codec: str = "uper", **fields: Any
) -> PutArguments:
    """Return names, payload, encoding and attachment of a product as they are sent."""
    t1_ns = fields.pop("t1_ns", seq * S)
    header = Header(
        id=product_id(robot, "test", product, t1_ns, seq, "c"),
        seq=seq,
        t0_ns=t1_ns,
        t1_ns=t1_ns,
        producer="test",
        config_hash="c",
        **({"frame": "site"} | fields),
    )
    names = {"robot": robot, "dfpc": "test", "port": product, "product": product}
    return names, encode(value, codec), encoding_string(type(value).__name__, codec), header.to_attachment()
