# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.ground_segmentation.inpainting import inpaint
from cdff_core.dfns.ground_segmentation.interface import GroundSegmentationInputs, GroundSegmentationOutputs
from cdff_core.dfns.ground_segmentation.simple_morphological_filter import SimpleMorphologicalFilter
from evaluation.ground_segmentation import ground_errors, read_classified


def segment(points: np.ndarray, **config: Any) -> GroundSegmentationOutputs:
    node = SimpleMorphologicalFilter()
    node.configure({"window_m": 15.0, **config})
    return node.process(GroundSegmentationInputs(points=points))


def village(rng: np.random.Generator, slope: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Return points of a hillside with five flat-roofed houses and trees, and a mask of the ground points."""
    x, y = rng.uniform(0, 80, (2, 9000))
    z = slope * x + 0.8 * np.sin(y / 9.0)
    ground = np.ones(len(x), dtype=bool)
    for cx, cy in ((15, 15), (60, 20), (30, 50), (62, 62), (12, 68)):
        house = (np.abs(x - cx) < 6) & (np.abs(y - cy) < 5)
        z[house], ground[house] = slope * (cx + 6) + 5.0, False
    tree = rng.random(len(x)) < 0.05
    z[tree] += rng.uniform(2.5, 8, tree.sum())
    ground[tree] = False
    return np.column_stack([x + 5.0e5, y + 5.4e6, z + 300.0]), ground


def test_houses_and_trees_on_a_slope_are_separated_from_the_ground(rng: np.random.Generator) -> None:
    points, truth = village(rng)
    is_ground = np.zeros(len(points), dtype=bool)
    is_ground[segment(points).ground] = True
    errors = ground_errors(is_ground, truth)
    assert errors["type_1"] < 2.0
    assert errors["type_2"] < 2.0


def test_heights_above_ground_are_returned_in_input_order(rng: np.random.Generator) -> None:
    points, _ = village(rng, slope=0.0)
    points[17] = np.nan
    out = segment(points)
    roof = np.flatnonzero((np.abs(points[:, 0] - 5.0e5 - 30) < 4) & (np.abs(points[:, 1] - 5.4e6 - 50) < 3))
    assert np.nanmin(out.height_above_ground[roof]) > 3.5
    assert np.isnan(out.height_above_ground[17])
    assert 17 not in out.ground
    np.testing.assert_array_equal(out.ground_points, points[out.ground])


def test_a_roof_wider_than_the_window_is_classified_as_ground(rng: np.random.Generator) -> None:
    points, _ = village(rng, slope=0.0)
    roof = np.flatnonzero(np.abs(points[:, :2] - [5.0e5 + 30, 5.4e6 + 50]).max(axis=1) < 2)
    assert np.isin(roof, segment(points, window_m=2.0).ground).mean() > 0.9
    assert not np.isin(roof, segment(points).ground).any()


def test_a_single_low_outlier_does_not_lower_the_ground(rng: np.random.Generator) -> None:
    points, truth = village(rng)
    points = np.vstack([points, [5.0e5 + 40.0, 5.4e6 + 30.0, 250.0]])
    ground = segment(points).ground
    assert len(points) - 1 not in ground
    assert np.isin(np.flatnonzero(truth), ground).mean() > 0.97


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.zeros((3, 2)), "expected"),
        (np.full((4, 3), np.nan), "none of 4 is finite"),
        (np.array([[0, 0, 0], [1e6, 1e6, 0.0]]), "max_cells"),
    ],
)
def test_unusable_clouds_are_refused(points: np.ndarray, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        segment(points)


def test_unknown_cells_are_the_mean_of_their_neighbours() -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(15.0))
    plane = 100.0 + 0.3 * x - 0.2 * y
    holes = plane.copy()
    holes[4:9, 5:12] = np.nan
    np.testing.assert_allclose(inpaint(holes), plane, atol=1e-3)


def test_a_single_point_and_a_line_of_points_are_classified_as_ground() -> None:
    assert len(segment(np.array([[1.0, 2.0, 3.0]])).ground) == 1
    assert len(segment(np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)])).ground) == 30


@pytest.mark.req("CDFF-CORE-084")
def test_the_total_error_on_classified_airborne_lidar_is_five_percent(
    real_data: Callable[[str], Path],
) -> None:
    folder = real_data("isprs_terrain")
    totals = []
    for name in ("samp11", "samp42"):
        points, truth = read_classified(folder / f"{name}-utm.pcd", folder / f"{name}-utm-ground.pcd")
        node = SimpleMorphologicalFilter()
        node.configure({})
        is_ground = np.zeros(len(points), dtype=bool)
        is_ground[node.process(GroundSegmentationInputs(points=points)).ground] = True
        totals.append(ground_errors(is_ground, truth)["total"])
    assert np.mean(totals) <= 5.0
