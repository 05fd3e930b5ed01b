# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cheapest ways over the cells of a navigation map, to all eight neighbours."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import GridGeometry
from cdff_core.dfns.route_search._interface import RouteSearchInputs, RouteSearchInterface, RouteSearchOutputs

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SAFE, _CAUTION = 1, 2
#: Half of the neighbours; the others are the same edges the other way.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


class DijkstraConfig(DfnConfig):
    """What ground costs, and which may be passed."""

    cost_weight: float = Field(4.0, ge=0.0, le=1000.0, description="A metre of ground of cost 1 is so many more metres")
    caution_allowed: bool = Field(True, description="Whether caution may be passed, or safe ground only")


class Dijkstra(RouteSearchInterface):
    """A step costs its length times one plus the weighted mean cost of both cells.

    A step across a corner needs both cells beside it to be free: the rover does not slip between two hazards.
    """

    Config: ClassVar[type[DfnConfig]] = DijkstraConfig

    def process(self, inputs: RouteSearchInputs) -> RouteSearchOutputs:
        """Return costs and way; raises InputError, or RefusedError with start_blocked, goal_blocked or unreachable."""
        g = inputs.map.geometry
        classes = inputs.map.layer("class")
        free = (classes == _SAFE) | ((classes == _CAUTION) & self.config.caution_allowed)
        start = _cell(g, inputs.start, free, "start")
        goal = None if inputs.goal is None else _cell(g, inputs.goal, free, "goal")
        graph = self._graph(free, inputs.map.layer("cost"), g.resolution_m)
        if goal is None:
            costs = dijkstra(graph, directed=False, indices=start)
            return RouteSearchOutputs(costs_m=costs.reshape(g.shape), way=np.zeros((0, 2)))
        costs, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        if not np.isfinite(costs[goal]):
            raise RefusedError(f"no way from {inputs.start} to {inputs.goal}", ("unreachable",))
        cells = [goal]
        while cells[-1] != start:
            cells.append(int(before[cells[-1]]))
        row, col = np.divmod(np.array(cells[::-1]), g.cols)
        way = np.column_stack([g.x_centres_m()[col], g.y_centres_m()[row]])
        return RouteSearchOutputs(costs_m=costs.reshape(g.shape), way=way)

    def _graph(self, free: Mask, cost: NDArray[np.floating], cell_m: float) -> coo_array:
        """Edges between free neighbours, each once, metres."""
        rows, cols = free.shape
        index = np.arange(rows * cols).reshape(rows, cols)
        weight = 1.0 + self.config.cost_weight * np.nan_to_num(cost.astype(np.float64), nan=1.0)
        parts = []
        for dr, dc in _STEPS:
            here, there = _shifted((rows, cols), dr, dc)
            passable = free[here] & free[there]
            if dr and dc:  # the two cells beside the corner
                passable &= free[here[0], there[1]] & free[there[0], here[1]]
            length = cell_m * float(np.hypot(dr, dc))
            price = length * 0.5 * (weight[here] + weight[there])
            parts.append((index[here][passable], index[there][passable], price[passable]))
        i, j, price = (np.concatenate(column) for column in zip(*parts, strict=True))
        return coo_array((price, (i, j)), shape=(rows * cols, rows * cols)).tocsr()


def _shifted(shape: tuple[int, int], dr: int, dc: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of cells and of their neighbours ``dr`` rows and ``dc`` columns on."""
    rows, cols = shape
    left, right = (slice(0, cols - dc), slice(dc, cols)) if dc >= 0 else (slice(-dc, cols), slice(0, cols + dc))
    return (slice(0, rows - dr), left), (slice(dr, rows), right)


def _cell(geometry: GridGeometry, point_m: Float, free: Mask, name: str) -> int:
    """Index of the cell of a point; raises InputError outside the map, RefusedError where it is not free."""
    x, y = (float(v) for v in point_m)
    row, col, inside = geometry.cells_of([x], [y])
    if not inside[0]:
        raise InputError(f"{name} ({x:g}, {y:g}): expected a place within {tuple(geometry.bounds)}")
    if not free[row[0], col[0]]:
        raise RefusedError(f"{name} ({x:g}, {y:g}) lies on a hazard or unknown ground", (f"{name}_blocked",))
    return int(row[0]) * geometry.cols + int(col[0])
