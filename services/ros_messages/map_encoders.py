# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of CDFF as maps of ROS; ``maps`` has the other direction and the conventions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap
from services.ros_messages.encoding import Encoded, Outgoing, Target
from services.ros_messages.maps import COLUMNS_FIRST, GRID_MAP, OCCUPANCY_GRID
from services.ros_messages.message_types import RosTypes

#: Occupancy of the classes unknown, safe, caution and hazard.
_OCCUPANCY = np.array([-1, 0, 50, 100], np.int8)


def occupancy_grid(value: NavigationMap, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``nav_msgs/OccupancyGrid``: safe is 0, caution 50, hazard 100 and unknown -1."""
    grid = value.geometry
    classes = np.asarray(value.layer("class"))
    if classes.max(initial=0) >= len(_OCCUPANCY):
        raise InputError(f"layer class: {classes.max()}, expected at most {len(_OCCUPANCY) - 1}")
    ymin_m = grid.ymax_m - grid.rows * grid.resolution_m
    header = types.header(stamp_ns, target.new_frame(grid.frame))
    info = types.make(
        "nav_msgs/MapMetaData",
        map_load_time=header.stamp,
        resolution=grid.resolution_m,
        width=grid.cols,
        height=grid.rows,
        origin=_pose(types, grid.xmin_m, ymin_m),
    )
    data = _OCCUPANCY[classes[::-1]].reshape(-1)
    message = types.make("nav_msgs/OccupancyGrid", header=header, info=info, data=data)
    held = {"class": classes.astype(np.uint8)}
    back = NavigationMap.from_layers(grid, held, t0_ns=stamp_ns, t1_ns=stamp_ns)
    return Encoded((Outgoing(target.topic, OCCUPANCY_GRID, message),), back, "map")


def grid_map(value: ElevationMap, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``grid_map_msgs/GridMap`` with all layers as numbers of 32 bits."""
    layers = {name: np.asarray(value.layer(name), np.float32) for name in value.layer_names}
    message = grid_map_message(
        value.geometry, layers, types, stamp_ns, target.new_frame(value.geometry.frame)
    )
    back = ElevationMap.from_layers(value.geometry, layers, t0_ns=stamp_ns, t1_ns=stamp_ns)
    return Encoded((Outgoing(target.topic, GRID_MAP, message),), back, "map")


def grid_map_message(
    grid: GridGeometry | None,
    layers: dict[str, NDArray[np.float32]],
    types: RosTypes,
    stamp_ns: int,
    frame_id: str,
) -> Any:
    """Return ``grid_map_msgs/GridMap``; without a grid a map without cells."""
    header = types.header(stamp_ns, frame_id)
    rows, cols, edge_m = (0, 0, 0.0) if grid is None else (grid.rows, grid.cols, grid.resolution_m)
    x_m, y_m = (0.0, 0.0) if grid is None else (grid.xmin_m, grid.ymax_m)
    stamped = {"header": header}
    info = types.make(
        "grid_map_msgs/GridMapInfo",
        resolution=edge_m,
        length_x=cols * edge_m,
        length_y=rows * edge_m,
        pose=_pose(types, x_m + 0.5 * cols * edge_m, y_m - 0.5 * rows * edge_m),
        **(stamped if types.version == 1 else {}),
    )
    dim = [
        types.make("std_msgs/MultiArrayDimension", label=label, size=size, stride=stride)
        for label, size, stride in zip(COLUMNS_FIRST, (rows, cols), (rows * cols, cols), strict=True)
    ]
    layout = types.make("std_msgs/MultiArrayLayout", dim=dim, data_offset=0)
    arrays = [
        types.make(
            "std_msgs/Float32MultiArray", layout=layout, data=np.ascontiguousarray(a[:, ::-1]).reshape(-1)
        )
        for a in layers.values()
    ]
    return types.make(
        "grid_map_msgs/GridMap",
        info=info,
        layers=list(layers),
        basic_layers=[],
        data=arrays,
        outer_start_index=0,
        inner_start_index=0,
        **({} if types.version == 1 else stamped),
    )


def _pose(types: RosTypes, x_m: float, y_m: float) -> Any:
    return types.make(
        "geometry_msgs/Pose",
        position=types.vector(np.array([x_m, y_m, 0.0]), "Point"),
        orientation=types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
    )
