# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The map update rules of atlaas, for comparison with those of CDFF."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap
from evaluation.peers.atlaas import AtlaasMap

CELL = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 0.1, 0.1))
CELL_CENTRE = np.array([0.05, 0.05])


def scan(heights_m: np.ndarray) -> ElevationMap:
    points = np.column_stack([np.full((len(heights_m), 2), 0.05), heights_m])
    statistics = CellStatistics.from_points(CELL, points, stamps_ns=0)
    return ElevationMap.from_layers(CELL, statistics.to_layers(0), t0_ns=0, t1_ns=0)


def atlaas(*scans: ElevationMap, distances_m: tuple[float, ...] = (0.0, 0.0, 0.0)) -> ElevationMap:
    merged = AtlaasMap(CELL)
    for one, distance_m in zip(scans, distances_m, strict=False):
        merged.merge(one, CELL_CENTRE + np.array([distance_m, 0.0]))
    return merged.to_map(0)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def test_the_variance_includes_the_spread_between_scans_unlike_atlaas(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    low, high = rng.normal(0.0, 0.02, 200), rng.normal(0.3, 0.02, 200)
    ours = CellStatistics.from_points(
        CELL, np.column_stack([np.full((400, 2), 0.05), [*low, *high]]), stamps_ns=0
    ).to_layers(0)
    monkeypatch.setattr("evaluation.peers.atlaas.STEP_M", 1.0)  # otherwise the second scan replaces the first
    theirs = atlaas(scan(low), scan(high))
    assert np.sqrt(theirs.layer("variance")[0, 0]) == pytest.approx(0.02, rel=0.1)
    assert np.sqrt(ours["variance"][0, 0]) == pytest.approx(0.15, rel=0.02)
    assert theirs.layer("mean")[0, 0] == pytest.approx(ours["mean"][0, 0], abs=1e-6)
    assert theirs.layer("count")[0, 0] == 400


def test_a_contradicted_flat_cell_is_replaced(rng: np.random.Generator) -> None:
    result = atlaas(scan(rng.normal(0.0, 0.01, 50)), scan(rng.normal(0.5, 0.01, 30)))
    assert result.layer("count")[0, 0] == 30
    assert result.layer("mean")[0, 0] == pytest.approx(0.5, abs=0.01)


def test_the_nearer_of_two_scans_is_used(rng: np.random.Generator) -> None:
    one, other = scan(rng.normal(0.00, 0.01, 50)), scan(rng.normal(0.05, 0.01, 30))
    assert atlaas(one, other, distances_m=(1.0, 9.0)).layer("count")[0, 0] == 50
    assert atlaas(one, other, distances_m=(9.0, 1.0)).layer("count")[0, 0] == 30
    assert atlaas(one, other, distances_m=(1.0, 1.5)).layer("count")[0, 0] == 80
