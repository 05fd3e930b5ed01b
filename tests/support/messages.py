# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Random messages of every message type, so that a new type needs no new test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cdff_common.codecs.wire_types import message_node
from cdff_common.types.schema import (
    Alias,
    Array,
    Boolean,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    OctetString,
    Real,
    Struct,
    Text,
)
from cdff_common.types.schema_table import MESSAGES
from cdff_common.types.validation import class_of

#: Names of all message types.
ALL = sorted(MESSAGES)
#: REALs at the limits of the encodings.
REALS = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.1,
    -0.5,
    3.0,
    255.0,
    256.0,
    65535.5,
    1e-7,
    1e22,
    5e-324,
    -5e-324,
    2.2250738585072014e-308,
    2.225073858507201e-308,
    1.7976931348623157e308,
    -1.7976931348623157e308,
    2.0**53 - 1,
    2.0**53,
    2.0**-300,
    2.0**300,
    float("nan"),
    float("inf"),
    float("-inf"),
]
_TEXTS = ["", "mana/lidar", "é", "x" * 256, "\udce9", "1"]
#: Types with fields that must be consistent with each other; independent random values are not.
_CONSISTENT = {
    "PointCloudData",
    "LidarScanData",
    "PoseTrajectoryData",
    "ElevationMap",
    "NavigationMap",
    "PoseGraph",
    "PoseGraphVertices",
    "PoseGraphEdges",
    "LandmarkMapData",
    "KeyFrameData",
    "MeshData",
    "ObjectTrackData",
    "ImuSpanData",
    "LidarMap",
    "LidarMapClouds",
    "LidarMapPosition",
    "VisualMap",
    "VisualMapPoints",
    "BundleCameras",
    "BundleLenses",
    "BundlePoints",
    "BundleObservations",
    "BundlePrior",
    "BundleProblem",
    "GroundAreasData",
}


def random_message(name: str, rng: np.random.Generator) -> Any:
    """Return a message of a type with extreme values and few elements."""
    return _value(message_node(name), rng)


def long_message(name: str, rng: np.random.Generator) -> Any:
    """Return a message with up to 40 elements if the type is a list of messages, else a random message."""
    node = message_node(name)
    if isinstance(node, Alias) and isinstance(node.node, ListOf) and isinstance(node.node.element, Struct):
        items = tuple(_value(node.node.element, rng) for _ in range(min(node.node.high, 40)))
        return class_of(node.class_name)(items)
    return random_message(name, rng)


def _value(node: Node | Alias, rng: np.random.Generator) -> Any:
    match node:
        case Struct():
            cls = class_of(node.class_name)
            if node.class_name in _CONSISTENT:
                return _consistent(node, rng)
            return cls(*[_value(f.node, rng) for f in node.fields])
        case Alias():
            return class_of(node.class_name)(_value(node.node, rng))
        case Choice():
            field = node.alternatives[int(rng.integers(len(node.alternatives)))]
            return class_of(node.class_name)(field.attribute, _value(field.node, rng))
        case ListOf():
            return tuple(_value(node.element, rng) for _ in range(_size(node.low, node.high, rng)))
        case Array():
            return _array(node, tuple(_size(low, high, rng) for low, high in node.dims), rng)
        case OctetString():
            shape = (_size(0, 9, rng), node.columns) if node.columns else (_size(0, 9, rng),)
            return rng.integers(0, 100, shape).astype(node.dtype)
        case Text():
            return _TEXTS[int(rng.integers(len(_TEXTS)))]
        case Enumeration():
            return class_of(node.class_name)(node.members[int(rng.integers(len(node.members)))][1])
        case Integer():
            return int(rng.choice([node.low, node.high, max(node.low, 0), min(node.high, 1)]))
        case Real():
            return REALS[int(rng.integers(len(REALS)))]
        case Boolean():
            return bool(rng.integers(2))


def _size(low: int, high: int, rng: np.random.Generator) -> int:
    return int(rng.integers(low, min(high, low + 4) + 1))


def _array(node: Array, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    if isinstance(node.element, Real):
        return rng.choice(REALS, shape)
    if isinstance(node.element, Boolean):
        return rng.integers(0, 2, shape).astype(np.bool_)
    return rng.choice([node.element.low, node.element.high, 0, 1], shape).astype(node.dtype)


def _visual_points(counts: np.ndarray, rng: np.random.Generator) -> Any:
    n = int(counts.sum())
    descriptors = class_of("Array3D")()
    if n:
        descriptors = class_of("Array3D").from_array(rng.integers(0, 255, (n, 4)).astype(np.uint8))
    positions, sigmas = _reals(3, np.float32)(n, rng), rng.random(n).astype(np.float32)
    return class_of("VisualMapPoints")(counts, positions, sigmas, descriptors)


def _consistent(node: Struct, rng: np.random.Generator) -> Any:
    cls = class_of(node.class_name)
    n = int(rng.integers(0, 5))
    if node.class_name == "PointCloudData":
        return cls(rng.choice(REALS, (n, 3)), rng.choice(REALS, (n, 3)), rng.integers(-9, 9, n))
    if node.class_name == "LidarScanData":
        return cls(
            rng.normal(size=(n, 3)).astype(np.float32), np.arange(n), np.arange(n), np.zeros(0, np.uint16)
        )
    if node.class_name == "PoseTrajectoryData":
        return cls(np.arange(n), rng.choice(REALS, (n, 7)), rng.choice(REALS, (n, 36)))
    if node.class_name in _COLUMNS:
        return cls(*[make(n, rng) for make in _COLUMNS[node.class_name]])
    if node.class_name == "PoseGraph":
        vertices = _value(node.fields[1].node, rng)
        edges = class_of("PoseGraphEdges")()
        if len(vertices.ids):
            ends = rng.choice(vertices.ids, (n, 2))
            edges = class_of("PoseGraphEdges")(ends, _reals(7)(n, rng), _reals(36)(n, rng), _octets(n, rng))
        return cls(_value(node.fields[0].node, rng), vertices, edges)
    if node.class_name == "GroundAreasData":
        rings = rng.integers(1, 3, n)
        corners = rng.integers(3, 6, rings.sum())
        return cls(_octets(n, rng), rng.normal(size=n), rings, corners, _reals(2)(int(corners.sum()), rng))
    if node.class_name == "LidarMapPosition":
        return cls(np.arange(min(n, 1)), _reals(7)(min(n, 1), rng))
    if node.class_name == "LidarMapClouds":
        counts = rng.integers(0, 4, n)
        return cls(counts, _reals(3, np.float32)(int(counts.sum()), rng))
    if node.class_name == "LidarMap":
        graph = _value(node.fields[1].node, rng)
        ids = graph.vertices.ids
        clouds = class_of("LidarMapClouds")(np.ones(len(ids), np.int64), _reals(3, np.float32)(len(ids), rng))
        position = class_of("LidarMapPosition")(ids[:1], _reals(7)(len(ids[:1]), rng))
        return cls(_value(node.fields[0].node, rng), graph, clouds, position)
    if node.class_name == "VisualMapPoints":
        counts = rng.integers(0, 4, n)
        return _visual_points(counts, rng)
    if node.class_name == "VisualMap":
        graph = _value(node.fields[1].node, rng)
        points = _visual_points(np.ones(len(graph.vertices.ids), np.int64), rng)
        return cls(_value(node.fields[0].node, rng), graph, points)
    if node.class_name == "BundleProblem":
        metadata, cameras, lenses, points = (_value(field.node, rng) for field in node.fields[:4])
        cameras = cameras if len(lenses.values) else class_of("BundleCameras")()
        return cls(
            metadata, cameras, lenses, points, class_of("BundleObservations")(), class_of("BundlePrior")()
        )
    if node.class_name == "BundlePrior":
        return cls(np.arange(n), _reals(7)(n, rng), rng.normal(size=36 * n * n), rng.normal(size=6 * n))
    metadata = class_of("GridMapMetadata")(
        frame_id="site", resolution=0.5, x_min=-1.0, y_max=1.0, rows=2, cols=n
    )
    layers = tuple(
        class_of("GridLayer").from_array(name, rng.normal(size=(2, n)).astype(dtype))
        for name, dtype in (("mean", np.float32), ("class", np.uint8))
    )
    return cls(metadata, layers)


Column = Callable[[int, np.random.Generator], Any]


def _reals(columns: int, dtype: type = np.float64) -> Column:
    return lambda n, rng: rng.normal(size=(n, columns)).astype(dtype)


def _increasing(n: int, rng: np.random.Generator) -> np.ndarray:
    return np.arange(n, dtype=np.int64) * 3 - 5


def _octets(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 3, n).astype(np.uint8)


def _empty(columns: int, dtype: type) -> Column:
    return lambda n, rng: np.zeros((0, columns) if columns else 0, dtype)


def _descriptors(n: int, rng: np.random.Generator) -> Any:
    return class_of("Array3D").from_array(rng.integers(0, 256, (n, 32)).astype(np.uint8))


#: Functions that return the columns of types in which all columns have the same length.
_COLUMNS: dict[str, tuple[Column, ...]] = {
    "ImuSpanData": (_increasing, _reals(3), _reals(3), _reals(3)),
    "PoseGraphVertices": (_increasing, _increasing, _reals(7), _octets),
    "PoseGraphEdges": (lambda n, rng: rng.integers(-9, 9, (n, 2)), _reals(7), _reals(36), _octets),
    "LandmarkMapData": (_increasing, _reals(3), _reals(9), _empty(0, np.uint32), _descriptors),
    "KeyFrameData": (_reals(2, np.float32), _empty(0, np.float32), _increasing, _descriptors),
    "MeshData": (
        _reals(3),
        lambda n, rng: np.zeros((n, 3), np.uint32),
        _reals(3, np.float32),
        lambda n, rng: rng.integers(0, 256, (n, 3)).astype(np.uint8),
    ),
    "BundleCameras": (_increasing, _increasing, _reals(7), lambda n, rng: np.zeros(n, np.uint32), _octets),
    "BundleLenses": (_reals(10), lambda n, rng: np.zeros(n, np.uint32)),
    "BundlePoints": (_increasing, _reals(3), _octets),
    "BundleObservations": (
        lambda n, rng: np.zeros(n, np.uint32),
        lambda n, rng: np.zeros(n, np.uint32),
        _reals(3),
    ),
    "ObjectTrackData": (
        _increasing,
        _reals(7),
        _empty(6, np.float64),
        _reals(36),
        _empty(36, np.float64),
        _reals(6),
        _empty(2, np.float64),
        _empty(2, np.float64),
    ),
}
