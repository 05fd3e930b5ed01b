# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Guidance to a goal: the next leg on the mapped terrain, towards a goal that may lie outside the map."""

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

#: Ends of earlier legs are avoided: radius and additional cost for each, metres.
_REVISIT_RADIUS_M, _REVISIT_COST_M = 2.0, 10.0
#: Largest distance of the rover from the first free cell, metres.
_MAX_START_DISTANCE_M = 1.5
_FREE = (1, 2)


class Guidance:
    """Chooses legs on navigation maps.

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

    def leg(self, ground: NavigationMap, at_m: FloatArray, goal_m: FloatArray) -> FloatArray:
        """Return the next path: corners ``(n, 2)`` in the map's frame, from the position of the rover.

        It leads to the goal if the map has a path to it, otherwise to the cell of lowest total cost: the
        cost of the path to the cell, plus the straight distance from there to the goal at the highest cost.

        Raises
        ------
        RefusedError
            ``no_path`` if no free cell is near, or no better cell can be reached.
        """
        start = _nearest_free(ground, at_m, _MAX_START_DISTANCE_M)
        costs = self._route.process(RouteSearchInputs(map=ground, start=start)).costs_m
        end = self._end(ground, costs, goal_m)
        if np.linalg.norm(end - start) < 2.0 * ground.geometry.resolution_m:
            raise RefusedError(
                f"no path on from {at_m.round(1).tolist()} to {goal_m.round(1).tolist()}", ("no_path",)
            )
        path = self._route.process(RouteSearchInputs(map=ground, start=start, goal=end)).route
        if np.abs(start - at_m).max() <= 0.5 * ground.geometry.resolution_m:  # in the rover's own cell
            path[0] = at_m
            path = _straightened(ground, path)
        else:
            path = np.vstack([at_m, _straightened(ground, path)])
        path = _shorten(_up_to_sharp_turn(path), self._leg_m)
        self._ends.append(path[-1])
        return path

    def _end(self, ground: NavigationMap, costs: NDArray[np.float64], goal_m: FloatArray) -> FloatArray:
        g = ground.geometry
        row, col, inside = g.cells_of([goal_m[0]], [goal_m[1]])
        if inside[0] and np.isfinite(costs[row[0], col[0]]):
            return np.array([g.x_centres_m()[col[0]], g.y_centres_m()[row[0]]])
        x, y = g.centres_m()
        # unobserved terrain counts as the most difficult
        max_cost_per_m = 1.0 + self._route.config.cost_weight
        total = costs + max_cost_per_m * np.hypot(x - goal_m[0], y - goal_m[1])
        for previous_end in self._ends:
            total += _REVISIT_COST_M * (
                np.hypot(x - previous_end[0], y - previous_end[1]) < _REVISIT_RADIUS_M
            )
        best = np.unravel_index(int(np.argmin(total)), total.shape)
        return np.array([x[best], y[best]])


def _nearest_free(ground: NavigationMap, at_m: FloatArray, within_m: float) -> FloatArray:
    """Return the centre of the nearest free cell; raises RefusedError if none is within a distance."""
    x, y = ground.geometry.centres_m()
    distance_m = np.where(np.isin(ground.layer("class"), _FREE), np.hypot(x - at_m[0], y - at_m[1]), np.inf)
    best = np.unravel_index(int(np.argmin(distance_m)), distance_m.shape)
    if not distance_m[best] <= within_m:
        raise RefusedError(f"no free ground within {within_m:g} m of {at_m.round(1).tolist()}", ("no_path",))
    return np.array([x[best], y[best]])


def _straightened(ground: NavigationMap, path: FloatArray) -> FloatArray:
    """Return the path without the corners that are not needed to avoid terrain of higher cost."""
    g, classes = ground.geometry, ground.layer("class")
    cost = np.where(np.isin(classes, _FREE), np.nan_to_num(ground.layer("cost"), nan=1.0), np.inf)
    row, col, _ = g.cells_of(path[:, 0], path[:, 1])
    along = cost[row, col]
    kept, at = [0], 0
    while at < len(path) - 1:
        reach = at + 1
        step = len(path) - 1 - at
        while step >= 1:
            to = min(at + step, len(path) - 1)
            if to > reach and _max_cost(g, cost, path[at], path[to]) <= along[at : to + 1].max() + 1e-6:
                reach = to
                break
            step //= 2
        kept.append(reach)
        at = reach
    return path[kept]


def _max_cost(geometry: GridGeometry, cost: NDArray[np.float64], a: FloatArray, b: FloatArray) -> float:
    """Return the highest cost on the straight line between two points."""
    cell_m, ahead = geometry.resolution_m, b - a
    crossings = [np.array([0.0, 1.0])]
    for axis in np.flatnonzero(ahead):
        low, high = sorted((a[axis], b[axis]))
        edges = np.arange(np.ceil(low / cell_m), np.floor(high / cell_m) + 1.0) * cell_m
        crossings.append((edges - a[axis]) / ahead[axis])
    u = np.sort(np.concatenate(crossings))
    points = a + 0.5 * (u[1:] + u[:-1])[:, None] * ahead  # one in each crossed cell
    row, col, _ = geometry.cells_of(points[:, 0], points[:, 1])
    return float(cost[row, col].max())


def _up_to_sharp_turn(path: FloatArray) -> FloatArray:
    """Return the path up to the first corner that needs a stop; the next leg starts there."""
    for corners in range(3, len(path) + 1):
        if sharpest_turn_rad(path[corners - 3 : corners]) > 0.95 * MAX_CORNER_RAD:
            return path[: corners - 1]
    return path


def _shorten(path: FloatArray, length_m: float) -> FloatArray:
    """Return the first ``length_m`` of a path."""
    s = path_lengths_m(path)
    if s[-1] <= length_m:
        return path
    last = [np.interp(length_m, s, path[:, 0]), np.interp(length_m, s, path[:, 1])]
    return np.vstack([path[s < length_m], last])
