# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Overhangs: structure above empty space is separated, the ground itself is kept at any cell size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.formats.pcd import read_pcd
from cdff_core.dfns.dem_rasterisation._overhangs import find_overhanging_structure, find_overhangs


def cells_of(points: np.ndarray, edge_m: float) -> np.ndarray:
    row, col = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / edge_m).astype(np.int64).T
    return np.asarray(row * 1000 + col)


def slope(rng: np.random.Generator, angle_deg: float, per_m2: float, size_m: float = 60.0) -> np.ndarray:
    xy = rng.uniform(0.0, size_m, (round(per_m2 * size_m**2), 2))
    return np.c_[xy, np.tan(np.radians(angle_deg)) * xy[:, 0]]


@pytest.mark.parametrize("edge_m", [0.05, 1.0, 4.0, 10.0])
@pytest.mark.parametrize("angle_deg", [30.0, 45.0, 55.0])
def test_steep_ground_with_few_points_is_not_an_overhang(
    rng: np.random.Generator, angle_deg: float, edge_m: float
) -> None:
    points = slope(rng, angle_deg, 0.5)
    assert not find_overhangs(cells_of(points, edge_m), points, 1.0, edge_m).any()


@pytest.mark.parametrize("edge_m", [1.0, 4.0])
def test_a_canopy_above_a_slope_is_an_overhang(rng: np.random.Generator, edge_m: float) -> None:
    ground, canopy = slope(rng, 30.0, 2.0), slope(rng, 30.0, 2.0)
    points = np.r_[ground, canopy + np.array([0.0, 0.0, 6.0])]
    cell = cells_of(points, edge_m)
    is_overhang = find_overhangs(cell, points, 1.0, edge_m)
    assert not is_overhang[: len(ground)].any()
    is_above_ground = np.isin(cell[len(ground) :], cell[: len(ground)])
    # In a cell of 4 m the slope alone spans 2.3 m: a gap of 2 m remains in most cells.
    assert is_overhang[len(ground) :][is_above_ground].mean() > 0.95


def test_a_step_lower_than_half_of_the_cell_is_relief() -> None:
    step = np.array([[0.1, 0.1, 0.0], [0.2, 0.1, 0.0], [0.3, 0.1, 1.5], [0.4, 0.1, 1.5]])
    one_cell = np.zeros(4, np.int64)
    assert not find_overhangs(one_cell, step, 1.0, 4.0).any()
    assert find_overhangs(one_cell, step, 1.0, 1.0).tolist() == [False, False, True, True]


def test_above_a_gap_of_steep_ground_a_second_gap_is_found() -> None:
    points = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 2.5], [3.1, 0.0, 9.0], [3.2, 0.0, 9.1]])
    is_overhang = find_overhangs(np.zeros(4, np.int64), points, 1.0, 4.0)
    assert is_overhang.tolist() == [False, False, True, True]


def test_points_without_a_cell_are_ignored() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 5.0], [np.nan, 0.0, 0.0]])
    assert not find_overhangs(np.full(3, -1), points, 1.0, 4.0).any()
    assert not find_overhangs(np.zeros(0, np.int64), np.zeros((0, 3)), 1.0, 4.0).any()
    assert find_overhangs(np.array([0, 0, -1]), points, 1.0, 4.0).tolist() == [False, True, False]


def test_classified_ground_is_kept_at_cells_of_four_metres(real_data: Callable[[str], Path]) -> None:
    folder = real_data("isprs_terrain")
    for name, most in (("samp11", 0.06), ("samp42", 0.002)):
        ground = np.asarray(read_pcd(folder / f"{name}-utm-ground.pcd").points_m, dtype=np.float64)
        assert find_overhangs(cells_of(ground, 4.0), ground, 1.0, 4.0).mean() <= most


def test_structure_above_ground_in_its_cell_is_an_overhang() -> None:
    # On the ground of the first cell stand a wall and a roof; the second cell has structure only.
    points = np.array([[0.5, 0.5, 0.0], [1.0, 0.5, 3.0], [5.0, 0.5, 3.5], [9.0, 0.5, 3.0], [0.0, 0.0, 9.0]])
    is_structure = np.array([False, True, True, True, True])
    is_overhang = find_overhanging_structure(np.array([0, 0, 0, 1, -1]), points, is_structure, 1.0, 8.0)
    assert is_overhang.tolist() == [False, True, True, False, False]


@pytest.mark.parametrize("angle_deg", [30.0, 45.0, 55.0])
def test_steep_ground_classified_as_structure_is_kept(rng: np.random.Generator, angle_deg: float) -> None:
    points = slope(rng, angle_deg, 0.5)
    is_structure = points[:, 2] > 10.0
    cell = cells_of(points, 8.0)
    assert not find_overhanging_structure(cell, points, is_structure, 1.0, 8.0).any()


def test_without_structure_there_is_no_overhang() -> None:
    points = np.zeros((2, 3))
    for is_structure in (np.zeros(2, np.bool_), np.ones(2, np.bool_)):
        assert not find_overhanging_structure(np.zeros(2, np.int64), points, is_structure, 1.0, 8.0).any()
