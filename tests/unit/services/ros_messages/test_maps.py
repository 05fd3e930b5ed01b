# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of ROS become maps of CDFF, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap
from services.ros_messages.conversions import CONVERSIONS
from services.ros_messages.encoding import Target
from services.ros_messages.map_encoders import grid_map, occupancy_grid
from services.ros_messages.maps import (
    GRID_MAP,
    OCCUPANCY_GRID,
    elevation_map,
    navigation_map,
)
from services.ros_messages.message_types import RosTypes
from services.ros_messages.topics import Topic

_STAMP_NS = 1_600_000_000_000_001_000
_VERSIONS = {version: RosTypes(version) for version in (1, 2)}
_TOPICS = {name: Topic("/map", "mana", CONVERSIONS[name]) for name in (OCCUPANCY_GRID, GRID_MAP)}
_TARGET = Target("/map", "mana", "site", lambda name: name.removeprefix("mana/"), {}, {})
_SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, max_side=5)
_EDGES = st.tuples(st.integers(-50, 50), st.integers(-50, 50))


def _grid(shape: tuple[int, ...], edges: tuple[int, int], resolution_m: float) -> GridGeometry:
    x, y = edges
    return GridGeometry("mana/odom", resolution_m, x * resolution_m, y * resolution_m, *shape)


def _through_bytes(message: Any, name: str, version: int) -> Any:
    types = _VERSIONS[version]
    return types.deserialize(bytes(types.serialize(message, name)), name)


@settings(max_examples=50, deadline=None)
@given(
    version=st.sampled_from([1, 2]),
    classes=hnp.arrays(np.uint8, _SHAPES, elements=st.integers(0, 3)),
    edges=_EDGES,
    resolution_m=st.sampled_from([0.05, 0.1, 0.2, 1.0]),
)
def test_a_navigation_map_is_equal_after_an_occupancy_grid(
    version: int, classes: Any, edges: tuple[int, int], resolution_m: float
) -> None:
    layers = {"class": classes}
    grid = _grid(classes.shape, edges, resolution_m)
    value = NavigationMap.from_layers(grid, layers, t0_ns=_STAMP_NS, t1_ns=_STAMP_NS)
    (out,) = occupancy_grid(value, _TARGET, _VERSIONS[version], _STAMP_NS).messages
    message = _through_bytes(out.message, OCCUPANCY_GRID, version)
    back, frame, _ = navigation_map(message, _TOPICS[OCCUPANCY_GRID], _STAMP_NS)
    assert frame == "mana/odom"
    assert back.geometry == value.geometry
    np.testing.assert_array_equal(back.layer("class"), classes)


@settings(max_examples=50, deadline=None)
@given(
    version=st.sampled_from([1, 2]),
    heights=hnp.arrays(np.float32, _SHAPES, elements=st.floats(-1e3, 1e3, width=32) | st.just(np.nan)),
    edges=_EDGES,
    resolution_m=st.sampled_from([0.05, 0.1, 0.5]),
)
def test_an_elevation_map_is_equal_after_a_grid_map(
    version: int, heights: Any, edges: tuple[int, int], resolution_m: float
) -> None:
    layers = {"mean": heights, "variance": np.abs(heights)}
    grid = _grid(heights.shape, edges, resolution_m)
    value = ElevationMap.from_layers(grid, layers, t0_ns=_STAMP_NS, t1_ns=_STAMP_NS)
    (out,) = grid_map(value, _TARGET, _VERSIONS[version], _STAMP_NS).messages
    message = _through_bytes(out.message, GRID_MAP, version)
    back, _, _ = elevation_map(message, _TOPICS[GRID_MAP], _STAMP_NS)
    assert back.geometry == value.geometry
    for name, array in layers.items():
        np.testing.assert_array_equal(back.layer(name), array)


def test_cells_of_a_grid_map_are_where_its_library_has_them() -> None:
    """Index (i, j) is at x = x_max - (i + 1/2) d, y = y_max - (j + 1/2) d; the matrix is by columns."""
    heights = np.arange(6, dtype=np.float32).reshape(2, 3)
    grid = _grid((2, 3), (4, 10), 0.5)
    value = ElevationMap.from_layers(grid, {"mean": heights}, t0_ns=_STAMP_NS, t1_ns=_STAMP_NS)
    message = grid_map(value, _TARGET, _VERSIONS[2], _STAMP_NS).messages[0].message
    (array,) = message.data
    matrix = np.asarray(array.data).reshape((3, 2), order="F")
    for i, j in np.ndindex(3, 2):
        x_m = message.info.pose.position.x + message.info.length_x / 2 - (i + 0.5) * 0.5
        y_m = message.info.pose.position.y + message.info.length_y / 2 - (j + 0.5) * 0.5
        row, col, _ = grid.cells_of(np.array([x_m]), np.array([y_m]))
        assert matrix[i, j] == heights[row[0], col[0]]


def test_the_circular_buffer_of_a_grid_map_is_unrolled() -> None:
    heights = np.arange(6, dtype=np.float32).reshape(2, 3)
    value = ElevationMap.from_layers(_grid((2, 3), (0, 2), 1.0), {"mean": heights}, t0_ns=0, t1_ns=0)
    message = grid_map(value, _TARGET, _VERSIONS[2], _STAMP_NS).messages[0].message
    (array,) = message.data
    matrix = np.roll(np.asarray(array.data).reshape((3, 2), order="F"), (2, 1), axis=(0, 1))
    array.data = matrix.ravel(order="F")
    message.outer_start_index, message.inner_start_index = 2, 1
    back, _, _ = elevation_map(message, _TOPICS[GRID_MAP], _STAMP_NS)
    np.testing.assert_array_equal(back.layer("mean"), heights)


def test_occupancies_are_classes_by_the_limits_of_the_map_server() -> None:
    value = NavigationMap.from_layers(
        _grid((1, 6), (0, 0), 1.0), {"class": np.zeros((1, 6), np.uint8)}, t0_ns=0, t1_ns=0
    )
    message = occupancy_grid(value, _TARGET, _VERSIONS[2], _STAMP_NS).messages[0].message
    message.data = np.array([-1, 0, 25, 26, 64, 65], np.int8)
    back, _, _ = navigation_map(message, _TOPICS[OCCUPANCY_GRID], _STAMP_NS)
    np.testing.assert_array_equal(back.layer("class"), [[0, 1, 1, 2, 2, 3]])


def _faulty_grid(fault: str) -> Any:
    value = NavigationMap.from_layers(
        _grid((2, 3), (0, 0), 0.1), {"class": np.zeros((2, 3), np.uint8)}, t0_ns=0, t1_ns=0
    )
    message = occupancy_grid(value, _TARGET, _VERSIONS[2], _STAMP_NS).messages[0].message
    if fault == "rotated":
        message.info.origin.orientation.z = 0.1
    elif fault == "not a number":
        message.info.origin.orientation.z = float("nan")
    elif fault == "short":
        message.data = message.data[:-1]
    elif fault == "huge":
        message.info.width = 4_000_000_000
    else:
        message.info.origin.position.x = 0.037
    return message


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("rotated", "along the axes"),
        ("not a number", "along the axes"),
        ("short", "expected 2 x 3"),
        ("huge", "expected 2 x 4000000000"),
        ("unaligned", "multiple"),
    ],
)
def test_an_occupancy_grid_with_a_fault_is_refused(fault: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        navigation_map(_faulty_grid(fault), _TOPICS[OCCUPANCY_GRID], _STAMP_NS)


@pytest.mark.parametrize(
    ("field", "number", "reason"),
    [
        ("resolution", 0.0, "expected 1 to"),
        ("resolution", float("nan"), "expected 1 to"),
        ("length_x", 1e12, "expected 1 to"),
        ("length_y", 7.0, "6 cells in 2 dimensions"),
    ],
)
def test_a_grid_map_with_a_fault_is_refused(field: str, number: float, reason: str) -> None:
    heights = np.zeros((2, 3), np.float32)
    value = ElevationMap.from_layers(_grid((2, 3), (0, 2), 1.0), {"mean": heights}, t0_ns=0, t1_ns=0)
    message = grid_map(value, _TARGET, _VERSIONS[2], _STAMP_NS).messages[0].message
    setattr(message.info, field, number)
    with pytest.raises(InputError, match=reason):
        elevation_map(message, _TOPICS[GRID_MAP], _STAMP_NS)
