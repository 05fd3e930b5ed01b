# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError, RefusedError
from cdff_common.raster import GridGeometry
from cdff_common.types import NavigationMap
from cdff_core.dfns.route_search.dijkstra import Dijkstra
from cdff_core.dfns.route_search.interface import RouteSearchInputs, RouteSearchOutputs

GRID = GridGeometry.aligned("site", 0.5, (0, 0, 10, 8))


def search(
    classes: np.ndarray, start: Any, goal: Any = None, cost: float = 0.0, **config: Any
) -> RouteSearchOutputs:
    node = Dijkstra()
    node.configure(config)
    layers = {"class": classes.astype(np.uint8), "cost": np.full(GRID.shape, cost, np.float32)}
    navigation_map = NavigationMap.from_layers(GRID, layers, t0_ns=0, t1_ns=0)
    return node.process(
        RouteSearchInputs(
            map=navigation_map, start=np.array(start), goal=None if goal is None else np.array(goal)
        )
    )


def wall(gap_row: int | None) -> np.ndarray:
    classes = np.ones(GRID.shape)
    classes[:, 10] = 3
    if gap_row is not None:
        classes[gap_row, 10] = 1
    return classes


@pytest.mark.req("CDFF-CORE-073")
def test_the_cost_is_the_path_length_weighted_by_the_cost_of_the_terrain() -> None:
    result = search(np.ones(GRID.shape), (0.25, 0.25), (5.25, 0.25))
    row, col, _ = GRID.cells_of([5.25], [0.25])
    assert result.costs_m[row[0], col[0]] == pytest.approx(5.0)
    np.testing.assert_allclose(result.route[[0, -1]], [[0.25, 0.25], [5.25, 0.25]])
    costly = search(np.ones(GRID.shape), (0.25, 0.25), (5.25, 0.25), cost=0.5, cost_weight=4.0)
    assert costly.costs_m[row[0], col[0]] == pytest.approx(15.0)


def test_a_path_crosses_a_wall_only_through_a_gap() -> None:
    result = search(wall(3), (0.25, 0.25), (9.75, 0.25))
    crossing = result.route[np.isclose(result.route[:, 0], 5.25)]
    np.testing.assert_allclose(crossing, [[5.25, 6.25]])
    corner = np.ones(GRID.shape)
    corner[:8, 10], corner[8:, 11] = 3, 3  # the two halves of the wall touch at a corner
    with pytest.raises(RefusedError) as refusal:
        search(corner, (0.25, 0.25), (9.75, 0.25))
    assert refusal.value.reasons == ("unreachable",)


@pytest.mark.parametrize("blocked", [0, 3])
def test_unknown_ground_is_impassable_like_a_hazard(blocked: int) -> None:
    classes = np.ones(GRID.shape)
    classes[:, 10] = blocked
    result = search(classes, (0.25, 0.25))
    assert np.isinf(result.costs_m[:, 10:]).all()
    assert np.isfinite(result.costs_m[:, :10]).all()
    assert result.route.shape == (0, 2)


def test_caution_cells_are_used_only_if_allowed() -> None:
    classes = np.ones(GRID.shape)
    classes[:, 10] = 2
    assert np.isfinite(search(classes, (0.25, 0.25)).costs_m).all()
    assert np.isinf(search(classes, (0.25, 0.25), caution_allowed=False).costs_m[:, 10:]).all()


def test_costs_agree_with_an_exhaustive_search(rng: np.random.Generator) -> None:
    classes = np.where(rng.random(GRID.shape) < 0.25, 3, 1)
    classes[15, 0] = 1
    costs = search(classes, (0.25, 0.25)).costs_m
    best = np.full(GRID.shape, np.inf)
    best[15, 0] = 0.0
    for _ in range(200):  # Bellman–Ford
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                for r in range(max(0, -dr), 16 - max(0, dr)):
                    for c in range(max(0, -dc), 20 - max(0, dc)):
                        both_neighbours_safe = classes[r, c + dc] == classes[r + dr, c] == 1
                        if classes[r, c] == classes[r + dr, c + dc] == 1 and both_neighbours_safe:
                            best[r + dr, c + dc] = min(
                                best[r + dr, c + dc], best[r, c] + 0.5 * np.hypot(dr, dc)
                            )
        if np.array_equal(np.isfinite(best), np.isfinite(costs)) and np.allclose(best, costs):
            break
    np.testing.assert_allclose(costs, best)


def test_a_start_outside_the_map_a_blocked_goal_and_an_invalid_weight_are_refused() -> None:
    with pytest.raises(InputError, match="start"):
        search(np.ones(GRID.shape), (-1.0, 0.0))
    with pytest.raises(RefusedError) as refusal:
        search(wall(None), (0.25, 0.25), (5.25, 0.25))
    assert refusal.value.reasons == ("goal_blocked",)
    with pytest.raises(ConfigurationError):
        search(np.ones(GRID.shape), (0.25, 0.25), cost_weight=-1.0)
