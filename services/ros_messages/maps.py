# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of ROS: ``nav_msgs/OccupancyGrid`` is a NavigationMap, ``grid_map_msgs/GridMap`` an ElevationMap.

CDFF has row 0 at the largest y. An occupancy grid has it at the smallest y. A grid map has rows along -x and
columns along -y, in a circular buffer (Fankhauser and Hutter, 2016, doi 10.1007/978-3-319-26054-9_5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import MAX_CELLS, GridGeometry
from cdff_common.types import ElevationMap, NavigationMap
from services.ros_messages.topics import Topic

OCCUPANCY_GRID, GRID_MAP = "nav_msgs/msg/OccupancyGrid", "grid_map_msgs/msg/GridMap"
#: Limits of nav2's map server between free and occupied, per cent.
_FREE, _OCCUPIED = 25, 65
#: Largest angle of a map that counts as not rotated, as the vector part of its quaternion.
_MAX_ROTATION = 1e-6
#: Labels of the dimensions of a matrix that is stored by columns.
COLUMNS_FIRST = ("column_index", "row_index")


def navigation_map(message: Any, topic: Topic, stamp_ns: int) -> tuple[NavigationMap, str, None]:
    """Return the classes of an occupancy grid: unknown, free up to 25 %, occupied from 65 %, caution between.

    Raises
    ------
    InputError
        If the grid is rotated, its edges are no multiples of its resolution, or its data do not fit its size.
    """
    info, frame = message.info, topic.frame(message.header.frame_id)
    _check_axes(info.origin.orientation)
    rows, cols = int(info.height), int(info.width)
    cells = np.asarray(message.data, np.int8)
    if len(cells) != rows * cols:
        raise InputError(f"occupancy grid with {len(cells)} cells: expected {rows} x {cols}")
    # The resolution has 32 bits, so that 0.05 is not the nearest number of 64 bits.
    resolution_m = float(str(np.float32(info.resolution)))
    corner = info.origin.position
    geometry = GridGeometry(frame, resolution_m, corner.x, corner.y + rows * resolution_m, rows, cols)
    occupancy = cells.reshape(rows, cols)[::-1]
    classes = np.select([occupancy < 0, occupancy <= _FREE, occupancy < _OCCUPIED], [0, 1, 2], 3)
    layers = {"class": classes.astype(np.uint8)}
    return NavigationMap.from_layers(geometry, layers, t0_ns=stamp_ns, t1_ns=stamp_ns), frame, None


def elevation_map(message: Any, topic: Topic, stamp_ns: int) -> tuple[ElevationMap, str, None]:
    """Return the layers of a grid map, 32 bits each.

    Raises
    ------
    InputError
        If the map is rotated or above its frame, its edges are no multiples of its resolution, or the data of
        a layer do not fit its size.
    """
    info = message.info
    _check_axes(info.pose.orientation)
    centre, frame = info.pose.position, topic.frame(header_of(message).frame_id)
    if abs(centre.z) > _MAX_ROTATION:
        raise InputError(f"grid map at z {centre.z:g} m: expected 0, as heights are those in its frame")
    if len(message.layers) != len(message.data) or not message.layers:
        raise InputError(f"grid map with {len(message.layers)} layers and {len(message.data)} arrays")
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        sizes = np.array([info.length_x, info.length_y]) / np.float64(info.resolution)
        is_possible = bool(((sizes >= 0.5) & (sizes <= MAX_CELLS)).all() and sizes.prod() <= MAX_CELLS)
    if not is_possible:
        lengths = f"{info.length_x:g} x {info.length_y:g} m"
        raise InputError(
            f"grid map of {lengths} in cells of {info.resolution:g} m: expected 1 to {MAX_CELLS}"
        )
    cols, rows = (int(n) for n in np.rint(sizes))
    start = int(message.outer_start_index), int(message.inner_start_index)
    layers = {
        str(name): _layer(array, name, (cols, rows), start)
        for name, array in zip(message.layers, message.data, strict=True)
    }
    xmin_m = centre.x - 0.5 * cols * info.resolution
    ymax_m = centre.y + 0.5 * rows * info.resolution
    geometry = GridGeometry(frame, info.resolution, xmin_m, ymax_m, rows, cols)
    return ElevationMap.from_layers(geometry, layers, t0_ns=stamp_ns, t1_ns=stamp_ns), frame, None


def header_of(message: Any) -> Any:
    """Return the header of a message: in ROS 1 that of a grid map is a part of ``info``."""
    return message.header if hasattr(message, "header") else message.info.header


def _layer(array: Any, name: str, shape: tuple[int, int], start: Sequence[int]) -> NDArray[np.float32]:
    """Return a layer ``(rows, cols)`` of a grid map, whose matrix has the transposed ``shape``."""
    data = np.asarray(array.data, np.float32)
    dim = array.layout.dim
    if len(dim) != 2 or len(data) != shape[0] * shape[1]:
        raise InputError(f"layer {name}: {len(data)} cells in {len(dim)} dimensions, expected {shape}")
    if dim[0].label == COLUMNS_FIRST[0]:
        matrix = data.reshape(shape[1], shape[0]).T
    else:
        matrix = data.reshape(shape)
    matrix = np.roll(matrix, (-start[0], -start[1]), axis=(0, 1))
    return np.ascontiguousarray(matrix[::-1].T)


def _check_axes(q: Any) -> None:
    if not np.abs([q.x, q.y, q.z]).max() < _MAX_ROTATION:
        rotation = f"({q.x:g}, {q.y:g}, {q.z:g}, {q.w:g})"
        raise InputError(f"map with the orientation {rotation}: expected one along the axes of its frame")
