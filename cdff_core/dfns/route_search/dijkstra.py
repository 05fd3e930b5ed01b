# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cheapest paths over the cells of a navigation map, to all eight neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import GridGeometry
from cdff_core.dfns.route_search.interface import Inputs, Interface, Outputs

_SAFE, _CAUTION = 1, 2
#: Half of the neighbours; the others are the same edges in reverse.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


class DijkstraConfig(DfnConfig):
    """Parameters of Dijkstra."""

    cost_weight: float = Field(
        4.0, ge=0, le=1000, description="Path length added per metre of terrain of cost 1"
    )
    caution_allowed: bool = Field(True, description="Allow caution cells, where the rover must not turn")


class Dijkstra(Interface[DijkstraConfig]):
    """Cost of a step: its length times one plus the weighted mean cost of both cells.

    A diagonal step requires both adjacent cells to be free, so that no path passes between two hazards.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return costs and path; raises InputError, or RefusedError (blocked or unreachable)."""
        g = inputs.map.geometry
        classes = inputs.map.layer("class")
        free = (classes == _SAFE) | ((classes == _CAUTION) & self.config.caution_allowed)
        start = _cell(g, inputs.start, free, "start")
        goal = None if inputs.goal is None else _cell(g, inputs.goal, free, "goal")
        graph = self._graph(free, inputs.map.layer("cost"), g.resolution_m)
        if goal is None:
            costs = dijkstra(graph, directed=False, indices=start)
            return Outputs(costs_m=costs.reshape(g.shape), route=np.zeros((0, 2)))
        costs, previous = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        if not np.isfinite(costs[goal]):
            raise RefusedError(f"no route from {inputs.start} to {inputs.goal}", ("unreachable",))
        cells = [goal]
        while cells[-1] != start:
            cells.append(int(previous[cells[-1]]))
        row, col = np.divmod(np.array(cells[::-1]), g.cols)
        route = np.column_stack([g.x_centres_m()[col], g.y_centres_m()[row]])
        return Outputs(costs_m=costs.reshape(g.shape), route=route)

    def _graph(self, free: BoolArray, cost: NDArray[np.floating], cell_m: float) -> coo_array:
        """Return the edges between free neighbours, each once, metres."""
        rows, cols = free.shape
        index = np.arange(rows * cols).reshape(rows, cols)
        weight = 1.0 + self.config.cost_weight * np.nan_to_num(cost.astype(np.float64), nan=1.0)
        parts = []
        for dr, dc in _STEPS:
            here, there = _shifted((rows, cols), dr, dc)
            passable = free[here] & free[there]
            if dr and dc:  # the two cells adjacent to the corner
                passable &= free[here[0], there[1]] & free[there[0], here[1]]
            length = cell_m * float(np.hypot(dr, dc))
            price = length * 0.5 * (weight[here] + weight[there])
            parts.append((index[here][passable], index[there][passable], price[passable]))
        i, j, price = (np.concatenate(column) for column in zip(*parts, strict=True))
        return coo_array((price, (i, j)), shape=(rows * cols, rows * cols)).tocsr()


def _shifted(shape: tuple[int, int], dr: int, dc: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return slices of cells and of their neighbours ``dr`` rows and ``dc`` columns away."""
    rows, cols = shape
    left, right = (
        (slice(0, cols - dc), slice(dc, cols)) if dc >= 0 else (slice(-dc, cols), slice(0, cols + dc))
    )
    return (slice(0, rows - dr), left), (slice(dr, rows), right)


def _cell(geometry: GridGeometry, point_m: FloatArray, free: BoolArray, name: str) -> int:
    """Return the cell of a point; raises InputError outside the map, RefusedError if not free."""
    x, y = (float(v) for v in point_m)
    row, col, inside = geometry.cells_of([x], [y])
    if not inside[0]:
        raise InputError(f"{name} ({x:g}, {y:g}): expected a place within {tuple(geometry.bounds)}")
    if not free[row[0], col[0]]:
        raise RefusedError(f"{name} ({x:g}, {y:g}) lies on a hazard or unknown ground", (f"{name}_blocked",))
    return int(row[0]) * geometry.cols + int(col[0])
