# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Guidance to a goal: the next leg on what is known of the ground, towards a goal that may lie beyond it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import NavigationMap
from cdff_core.dfns.route_search._interface import RouteSearchInputs
from cdff_dev.missions.motion import SHARPEST_RAD, sharpest_turn_rad

#: Places where a leg ended already are avoided: within this, at this cost for each time, metres.
_AGAIN_M, _AGAIN_COST_M = 2.0, 10.0
#: How far from where the rover stands the first free cell may be, metres.
_STEP_OFF_M = 1.5
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
        """The way to drive next, corners ``(n, 2)`` in the map's frame from where the rover is.

        The goal, where the map shows a way there; else the cell from which the rest is cheapest, by what it costs to
        get there and what is left as the crow flies.

        Raises
        ------
        RefusedError
            ``no_way`` where nothing free is near, or nothing better than here can be reached.
        """
        start = _nearest_free(ground, at_m, _STEP_OFF_M)
        costs = self._route.process(RouteSearchInputs(ground, start)).costs_m
        end = self._end(ground, costs, goal_m)
        if np.linalg.norm(end - start) < 2.0 * ground.geometry.resolution_m:
            raise RefusedError(f"no way on from {at_m.round(1).tolist()} to {goal_m.round(1).tolist()}", ("no_way",))
        way = self._route.process(RouteSearchInputs(ground, start, end)).way
        if np.abs(start - at_m).max() <= 0.5 * ground.geometry.resolution_m:  # not first to the middle of its own cell
            way[0] = at_m
            way = _straightened(ground, way)
        else:
            way = np.vstack([at_m, _straightened(ground, way)])
        way = _cut(_until_it_turns_back(way), self._leg_m)
        self._ends.append(way[-1])
        return way

    def _end(self, ground: NavigationMap, costs: NDArray[np.float64], goal_m: FloatArray) -> FloatArray:
        g = ground.geometry
        row, col, inside = g.cells_of([goal_m[0]], [goal_m[1]])
        if inside[0] and np.isfinite(costs[row[0], col[0]]):
            return np.array([g.x_centres_m()[col[0]], g.y_centres_m()[row[0]]])
        x, y = g.centres_m()
        worst = 1.0 + self._route.config.cost_weight  # a metre of ground that is not seen yet is taken as the hardest
        total = costs + worst * np.hypot(x - goal_m[0], y - goal_m[1])
        for ended in self._ends:
            total += _AGAIN_COST_M * (np.hypot(x - ended[0], y - ended[1]) < _AGAIN_M)
        best = np.unravel_index(int(np.argmin(total)), total.shape)
        return np.array([x[best], y[best]])


def _nearest_free(ground: NavigationMap, at_m: FloatArray, within_m: float) -> FloatArray:
    """Middle of the free cell nearest to a place; raises RefusedError where none is near."""
    x, y = ground.geometry.centres_m()
    away = np.where(np.isin(ground.layer("class"), _FREE), np.hypot(x - at_m[0], y - at_m[1]), np.inf)
    best = np.unravel_index(int(np.argmin(away)), away.shape)
    if not away[best] <= within_m:
        raise RefusedError(f"no free ground within {within_m:g} m of {at_m.round(1).tolist()}", ("no_way",))
    return np.array([x[best], y[best]])


def _straightened(ground: NavigationMap, way: FloatArray) -> FloatArray:
    """The way with as few of its corners as do not lead it over ground that is worse than any on it."""
    g, classes = ground.geometry, ground.layer("class")
    cost = np.where(np.isin(classes, _FREE), np.nan_to_num(ground.layer("cost"), nan=1.0), np.inf)
    row, col, _ = g.cells_of(way[:, 0], way[:, 1])
    along = cost[row, col]
    kept, at = [0], 0
    while at < len(way) - 1:
        reach = at + 1
        step = len(way) - 1 - at
        while step >= 1:
            to = min(at + step, len(way) - 1)
            if to > reach and _worst(g, cost, way[at], way[to]) <= along[at : to + 1].max() + 1e-6:
                reach = to
                break
            step //= 2
        kept.append(reach)
        at = reach
    return way[kept]


def _worst(geometry: GridGeometry, cost: NDArray[np.float64], a: FloatArray, b: FloatArray) -> float:
    """Highest cost on the straight line between two places."""
    cell_m, ahead = geometry.resolution_m, b - a
    crossings = [np.array([0.0, 1.0])]
    for axis in np.flatnonzero(ahead):
        low, high = sorted((a[axis], b[axis]))
        edges = np.arange(np.ceil(low / cell_m), np.floor(high / cell_m) + 1.0) * cell_m
        crossings.append((edges - a[axis]) / ahead[axis])
    u = np.sort(np.concatenate(crossings))
    points = a + 0.5 * (u[1:] + u[:-1])[:, None] * ahead  # one in each cell that it crosses
    row, col, _ = geometry.cells_of(points[:, 0], points[:, 1])
    return float(cost[row, col].max())


def _until_it_turns_back(way: FloatArray) -> FloatArray:
    """The way up to the first corner that is too sharp to be driven without a stop: the next leg begins there."""
    for corners in range(3, len(way) + 1):
        if sharpest_turn_rad(way[corners - 3 : corners]) > 0.95 * SHARPEST_RAD:
            return way[: corners - 1]
    return way


def _cut(way: FloatArray, length_m: float) -> FloatArray:
    """The begin of a way."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    if s[-1] <= length_m:
        return way
    kept: Sequence[FloatArray] = list(way[s < length_m])
    last = np.array([np.interp(length_m, s, way[:, 0]), np.interp(length_m, s, way[:, 1])])
    return np.vstack([*kept, last])
