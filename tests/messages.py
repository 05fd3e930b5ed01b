# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Random messages of every type, from the codecs' table: a type that is added is tested without a new test."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.codecs.bridge import array_dtype, class_of, message_node
from cdff_common.codecs.schema import (
    Alias,
    Array,
    Boolean,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    Octets,
    Real,
    Struct,
    Text,
)
from cdff_common.codecs.schema_table import MESSAGES

ALL = sorted(MESSAGES)
#: Values at which REALs go wrong first.
REALS = [
    0.0, -0.0, 1.0, -1.0, 0.1, -0.5, 3.0, 255.0, 256.0, 65535.5, 1e-7, 1e22, 5e-324, -5e-324, 2.2250738585072014e-308,
    2.225073858507201e-308, 1.7976931348623157e308, -1.7976931348623157e308, 2.0**53 - 1, 2.0**53, 2.0**-300, 2.0**300,
    float("nan"), float("inf"), float("-inf"),
]  # fmt: skip
_TEXTS = ["", "mana/lidar", "é", "x" * 256, "\udce9", "1"]
#: Types whose fields must fit together, which numbers at random do not.
_CONSISTENT = {"PointCloudData", "LidarScanData", "PoseTrajectoryData", "ElevationMap", "NavigationMap"}


def random_message(name: str, rng: np.random.Generator) -> Any:
    """A message of a type with odd values and few elements."""
    return _value(message_node(name), rng)


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
        case Octets():
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
    return rng.choice([node.element.low, node.element.high, 0, 1], shape).astype(array_dtype(node))


def _consistent(node: Struct, rng: np.random.Generator) -> Any:
    cls = class_of(node.class_name)
    n = int(rng.integers(0, 5))
    if node.class_name == "PointCloudData":
        return cls(rng.choice(REALS, (n, 3)), rng.choice(REALS, (n, 3)), rng.integers(-9, 9, n))
    if node.class_name == "LidarScanData":
        return cls(rng.normal(size=(n, 3)).astype(np.float32), np.arange(n), np.arange(n), np.zeros(0, np.uint16))
    if node.class_name == "PoseTrajectoryData":
        return cls(np.arange(n), rng.choice(REALS, (n, 7)), rng.choice(REALS, (n, 36)))
    metadata = class_of("GridMapMetadata")(frame_id="site", resolution=0.5, x_min=-1.0, y_max=1.0, rows=2, cols=n)
    layers = tuple(
        class_of("GridLayer").from_array(name, rng.normal(size=(2, n)).astype(dtype))
        for name, dtype in (("mean", np.float32), ("class", np.uint8))
    )
    return cls(metadata, layers)
