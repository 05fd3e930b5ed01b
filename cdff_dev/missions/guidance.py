# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Guidance of a rover: the next leg on the mapped terrain, towards a goal that may be outside the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import NavigationMap
from cdff_core.dfns.route_search.interface import RouteSearchInputs
from cdff_dev.missions.motion import MAX_CORNER_RAD, sharpest_turn_rad
from cdff_dev.missions.tracks import path_lengths_m

#: Radius around the end of each previous leg in which a cell has an additional cost, and that cost, metres.
_REVISIT_RADIUS_M, _REVISIT_COST_M = 2.0, 10.0
#: Largest distance of the rover from the free cell where a path starts, metres.
_MAX_START_DISTANCE_M = 1.5
#: Classes of traversable cells: safe, caution.
_FREE = (1, 2)


class Guidance:
    """Plans the legs of a drive on navigation maps.

    Parameters
    ----------
    leg_m : float
        Longest leg, metres.
    """

    def __init__(self, leg_m: float) -> None:
        self._leg_m = leg_m
        self._route = Registry.default().make_dfn("RouteSearch")
        self._route.configure({})
        self._ends: list[FloatArray] = []

    def leg(self, ground: NavigationMap, position_m: FloatArray, goal_m: FloatArray) -> FloatArray:
        """Return the next path: corners ``(n, 2)`` in the map's frame, from the position of the rover.

        The path leads to the goal if the goal can be reached on the map. Otherwise it leads to the cell with
        the lowest total cost: the cost of the path to the cell, plus the straight distance from the cell to
        the goal times the highest cost per metre.

        Raises
        ------
        RefusedError
            With reason ``no_path`` if no free cell is near, or no cell closer to the goal can be reached.
        """
        start = _nearest_free(ground, position_m, _MAX_START_DISTANCE_M)
        costs = self._route.process(RouteSearchInputs(map=ground, start=start)).costs_m
        end = self._end_of_leg(ground, costs, goal_m)
        if np.linalg.norm(end - start) < 2.0 * ground.geometry.resolution_m:
            raise RefusedError(
                f"no further path from {position_m.round(1).tolist()} to {goal_m.round(1).tolist()}",
                ("no_path",),
            )
        path = self._route.process(RouteSearchInputs(map=ground, start=start, goal=end)).route
        if (
            np.abs(start - position_m).max() <= 0.5 * ground.geometry.resolution_m
        ):  # the rover is in the start cell
            path[0] = position_m
            path = _straighten(ground, path)
        else:
            path = np.vstack([position_m, _straighten(ground, path)])
        path = _shorten(_up_to_sharp_turn(path), self._leg_m)
        self._ends.append(path[-1])
        return path

    def _end_of_leg(
        self, ground: NavigationMap, costs: NDArray[np.float64], goal_m: FloatArray
    ) -> FloatArray:
        """Return the reachable position (2,) from which the rest of the way to the goal costs least."""
        geometry = ground.geometry
        row, col, inside = geometry.cells_of([goal_m[0]], [goal_m[1]])
        if inside[0] and np.isfinite(costs[row[0], col[0]]):
            return np.array([geometry.x_centres_m()[col[0]], geometry.y_centres_m()[row[0]]])
        x, y = geometry.centres_m()
        # unobserved terrain counts as the most difficult
        max_cost_per_m = 1.0 + self._route.config.cost_weight
        total = costs + max_cost_per_m * np.hypot(x - goal_m[0], y - goal_m[1])
        for previous_end in self._ends:
            total += _REVISIT_COST_M * (
                np.hypot(x - previous_end[0], y - previous_end[1]) < _REVISIT_RADIUS_M
            )
        best = np.unravel_index(int(np.argmin(total)), total.shape)
        return np.array([x[best], y[best]])


def _nearest_free(ground: NavigationMap, position_m: FloatArray, within_m: float) -> FloatArray:
    """Return the centre of the nearest free cell.

    Raises RefusedError if its distance exceeds ``within_m``.
    """
    x, y = ground.geometry.centres_m()
    distance_m = np.where(
        np.isin(ground.layer("class"), _FREE), np.hypot(x - position_m[0], y - position_m[1]), np.inf
    )
    best = np.unravel_index(int(np.argmin(distance_m)), distance_m.shape)
    if not distance_m[best] <= within_m:
        raise RefusedError(
            f"no free ground within {within_m:g} m of {position_m.round(1).tolist()}", ("no_path",)
        )
    return np.array([x[best], y[best]])


def _straighten(ground: NavigationMap, path: FloatArray) -> FloatArray:
    """Return the path with fewer corners: straight segments whose highest cost does not exceed the path's."""
    geometry, classes = ground.geometry, ground.layer("class")
    cost = np.where(np.isin(classes, _FREE), np.nan_to_num(ground.layer("cost"), nan=1.0), np.inf)
    row, col, _ = geometry.cells_of(path[:, 0], path[:, 1])
    path_cost = cost[row, col]
    corners, start = [0], 0
    while start < len(path) - 1:
        end = start + 1
        step = len(path) - 1 - start
        while step >= 1:
            candidate = min(start + step, len(path) - 1)
            allowed_cost = path_cost[start : candidate + 1].max() + 1e-6
            if candidate > end and _max_cost(geometry, cost, path[start], path[candidate]) <= allowed_cost:
                end = candidate
                break
            step //= 2
        corners.append(end)
        start = end
    return path[corners]


def _max_cost(geometry: GridGeometry, cost: NDArray[np.float64], start: FloatArray, end: FloatArray) -> float:
    """Return the highest cost on the straight line between two points."""
    cell_m, offset_m = geometry.resolution_m, end - start
    crossings = [np.array([0.0, 1.0])]  # of the line with cell edges, as fractions of its length
    for axis in np.flatnonzero(offset_m):
        low, high = sorted((start[axis], end[axis]))
        edges = np.arange(np.ceil(low / cell_m), np.floor(high / cell_m) + 1.0) * cell_m
        crossings.append((edges - start[axis]) / offset_m[axis])
    u = np.sort(np.concatenate(crossings))
    points = start + 0.5 * (u[1:] + u[:-1])[:, None] * offset_m  # one in each crossed cell
    row, col, _ = geometry.cells_of(points[:, 0], points[:, 1])
    return float(cost[row, col].max())


def _up_to_sharp_turn(path: FloatArray) -> FloatArray:
    """Return the path up to the first corner at which the rover must stop and turn in place."""
    for corners in range(3, len(path) + 1):
        if sharpest_turn_rad(path[corners - 3 : corners]) > 0.95 * MAX_CORNER_RAD:
            return path[: corners - 1]
    return path


def _shorten(path: FloatArray, length_m: float) -> FloatArray:
    """Return the first ``length_m`` of a path."""
    lengths_m = path_lengths_m(path)
    if lengths_m[-1] <= length_m:
        return path
    end = [np.interp(length_m, lengths_m, path[:, 0]), np.interp(length_m, lengths_m, path[:, 1])]
    return np.vstack([path[lengths_m < length_m], end])
