# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Paths of least cost over the cells of a navigation map, each connected with its eight neighbours."""

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

#: Classes of cells of a navigation map that may be crossed.
_SAFE, _CAUTION = 1, 2
#: Offsets (rows, columns) of half of the neighbours; edges to the other half are the same in reverse.
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


class DijkstraConfig(DfnConfig):
    """Parameters of Dijkstra."""

    cost_weight: float = Field(
        4.0, ge=0, le=1000, description="Path length added for each metre on terrain of cost 1"
    )
    caution_allowed: bool = Field(True, description="Allow caution cells, where the rover must not turn")


class Dijkstra(Interface[DijkstraConfig]):
    """Find paths whose cost is the sum over steps of length times one plus the weighted mean cost of both
    cells.

    A diagonal step requires that both adjacent cells are passable, so that no path leads between two hazards
    that touch at a corner.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return costs and path; raises InputError, or RefusedError if start or goal is blocked or
        unreachable.
        """
        g = inputs.map.geometry
        classes = inputs.map.layer("class")
        passable = (classes == _SAFE) | ((classes == _CAUTION) & self.config.caution_allowed)
        start = _cell(g, inputs.start, passable, "start")
        goal = None if inputs.goal is None else _cell(g, inputs.goal, passable, "goal")
        graph = self._graph(passable, inputs.map.layer("cost"), g.resolution_m)
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

    def _graph(self, passable: BoolArray, cost: NDArray[np.floating], cell_m: float) -> coo_array:
        """Return the costs of the edges between passable neighbours, each edge once, metres."""
        rows, cols = passable.shape
        index = np.arange(rows * cols).reshape(rows, cols)
        weight = 1.0 + self.config.cost_weight * np.nan_to_num(cost.astype(np.float64), nan=1.0)
        edges = []
        for dr, dc in _NEIGHBOURS:
            a, b = _neighbour_slices((rows, cols), dr, dc)
            is_edge = passable[a] & passable[b]
            if dr and dc:  # the two cells adjacent to the corner
                is_edge &= passable[a[0], b[1]] & passable[b[0], a[1]]
            length = cell_m * float(np.hypot(dr, dc))
            edge_cost = length * 0.5 * (weight[a] + weight[b])
            edges.append((index[a][is_edge], index[b][is_edge], edge_cost[is_edge]))
        i, j, edge_cost = (np.concatenate(column) for column in zip(*edges, strict=True))
        return coo_array((edge_cost, (i, j)), shape=(rows * cols, rows * cols)).tocsr()


def _neighbour_slices(
    shape: tuple[int, int], dr: int, dc: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the slices of the cells with a neighbour ``dr`` rows and ``dc`` columns away, and of these
    neighbours.
    """
    rows, cols = shape
    left, right = (
        (slice(0, cols - dc), slice(dc, cols)) if dc >= 0 else (slice(-dc, cols), slice(0, cols + dc))
    )
    return (slice(0, rows - dr), left), (slice(dr, rows), right)


def _cell(geometry: GridGeometry, point_m: FloatArray, passable: BoolArray, name: str) -> int:
    """Return the flat index of the cell of a point; raises InputError outside the map, RefusedError if not
    passable.
    """
    x, y = (float(v) for v in point_m)
    row, col, inside = geometry.cells_of([x], [y])
    if not inside[0]:
        raise InputError(f"{name} ({x:g}, {y:g}): expected a point within {tuple(geometry.bounds)}")
    if not passable[row[0], col[0]]:
        raise RefusedError(
            f"{name} ({x:g}, {y:g}) lies on terrain that is not passable", (f"{name}_blocked",)
        )
    return int(row[0]) * geometry.cols + int(col[0])
