# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of several robots are weighted by their errors: a bad robot does not change a good map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.raster.mosaic import AssembledWindow, Mosaic
from cdff_common.raster.weighting import RobotCells, compare_robots, fuse_robots
from evaluation.data_sets.clouds import kitti_pair

GRID = GridGeometry.aligned("site", 0.1, (-1.0, -1.0, 13.0, 13.0))


def ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return heights of a terrain that does not repeat, m."""
    return 0.3 * np.sin(0.9 * x + 0.05 * x * x) + 0.25 * np.cos(0.8 * y) + 0.1 * np.sin(2.1 * x + 1.3 * y)


def cells_of(robot: str, points: np.ndarray, sigma_m: float | None, grid: GridGeometry = GRID) -> RobotCells:
    """Return the cells of points with a stated standard deviation of the pose."""
    layers = CellStatistics.from_points(grid, points, stamps_ns=0).to_layers(0)
    if sigma_m is not None:
        is_observed = np.isfinite(layers["mean"])
        layers["variance"] = layers["variance"] + np.float32(sigma_m**2)
        values = {"pose_variance": sigma_m**2, "intensity": 1.0, "first_age_s": 0.5}
        layers |= {name: np.where(is_observed, v, np.nan).astype(np.float32) for name, v in values.items()}
    mosaic = Mosaic(grid, auxiliary=True)
    mosaic.add(grid, layers, 0)
    return RobotCells(robot, mosaic.assembled())


def scan(
    rng: np.random.Generator,
    robot: str,
    sigma_m: float | None,
    error_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> RobotCells:
    """Return the cells of a scan of the terrain that is displaced by an error of the pose."""
    x, y = rng.uniform(0.0, 12.0, (2, 40_000))
    points = np.column_stack([x, y, ground(x, y) + rng.normal(0.0, 0.01, len(x))])
    return cells_of(robot, points + error_m, sigma_m)


def rms_error_m(window: AssembledWindow, seen_by: RobotCells) -> float:
    """Return the error of the heights in the cells that a robot has observed."""
    x, y = GRID.centres_m()
    is_observed = seen_by.assembled.statistics.observed
    return float(np.sqrt(np.mean((window.statistics.mean - ground(x, y))[is_observed] ** 2)))


@pytest.mark.parametrize("stated_m", [0.6, 0.08])
def test_a_badly_localised_robot_does_not_change_the_map_of_a_good_one(
    rng: np.random.Generator, stated_m: float
) -> None:
    good, bad = scan(rng, "good", 0.03), scan(rng, "bad", stated_m, (1.2, 0.7, 0.1))
    agreements = compare_robots([bad, good])
    fused = fuse_robots([bad, good], agreements)
    assert rms_error_m(bad.assembled, bad) > 0.2
    assert rms_error_m(fused, good) < 1.02 * rms_error_m(good.assembled, good)
    (agreement,) = agreements
    assert (agreement.robot, agreement.references) == ("bad", ("good",))
    assert agreement.difference_m > 0.1
    assert (agreement.excess_sigma_m > 0.1) == (stated_m < 0.1)
    assert fused.disagreeing > 0.8 * agreement.cells
    assert agreement.registration is not None
    np.testing.assert_allclose(agreement.registration.T[:3, 3], [-1.2, -0.7, -0.1], atol=0.02)


def test_two_of_three_robots_outvote_an_overconfident_one(rng: np.random.Generator) -> None:
    parts = [
        scan(rng, "anna", 0.05),
        scan(rng, "boris", 0.05),
        scan(rng, "carl", 0.001, (1.2, 0.7, 0.3)),
    ]
    agreements = compare_robots(parts)
    assert [a.robot for a in agreements if a.excess_sigma_m > 0.0] == ["carl"]
    anna = parts[0]
    assert rms_error_m(fuse_robots(parts, agreements), anna) < 1.1 * rms_error_m(anna.assembled, anna)


def test_independent_errors_are_averaged_and_those_of_one_robot_are_not(rng: np.random.Generator) -> None:
    parts = [scan(rng, "anna", 0.1), scan(rng, "boris", 0.1)]
    fused = fuse_robots(parts, compare_robots(parts))
    assert fused.auxiliary is not None
    layers = fused.auxiliary.to_layers(fused.statistics, 0)
    is_observed = np.all([p.assembled.statistics.observed for p in parts], axis=0)
    assert np.nanmedian(layers["pose_variance"][is_observed]) == pytest.approx(0.005, rel=0.05)
    alone = parts[0].assembled.auxiliary
    assert alone is not None
    same = alone.to_layers(parts[0].assembled.statistics, 0)
    assert np.nanmedian(same["pose_variance"]) == pytest.approx(0.01, rel=1e-3)


def test_robots_that_agree_are_not_flagged(rng: np.random.Generator) -> None:
    parts = [scan(rng, "anna", 0.03), scan(rng, "boris", 0.05)]
    (agreement,) = compare_robots(parts)
    fused = fuse_robots(parts, (agreement,))
    assert (agreement.excess_sigma_m, agreement.registration) == (0.0, None)
    assert fused.disagreeing < 0.05 * agreement.cells


def test_cells_without_a_stated_error_are_pooled_as_from_all_points(rng: np.random.Generator) -> None:
    parts = [scan(rng, "anna", None), scan(rng, "boris", None, (0.0, 0.0, 0.02))]
    fused = fuse_robots(parts, compare_robots(parts)).statistics
    pooled = CellStatistics.empty(GRID)
    for part in parts:
        pooled.add(part.assembled.statistics)
    for name in ("count", "mean", "m2", "minimum", "maximum", "newest_ns"):
        np.testing.assert_allclose(getattr(fused, name), getattr(pooled, name), rtol=1e-9, atol=1e-9)


def test_a_moved_object_in_an_agreeing_map_is_flagged_and_not_averaged(rng: np.random.Generator) -> None:
    good, other = scan(rng, "good", 0.02), scan(rng, "other", 0.04)
    good_cells, other_cells = good.assembled.statistics, other.assembled.statistics
    other_cells.mean[50:56, 50:56] += 0.5
    fused = fuse_robots([good, other], compare_robots([good, other]))
    box = np.zeros(GRID.shape, dtype=bool)
    box[50:56, 50:56] = True
    box &= good_cells.observed & other_cells.observed
    assert fused.flagged[box].all()
    np.testing.assert_allclose(fused.statistics.mean[box], good_cells.mean[box])


@pytest.mark.slow
def test_a_real_scan_with_a_wrong_pose_changes_nothing_and_its_registration_is_found(
    real_data: Callable[[str], Path],
) -> None:
    source, target, T = kitti_pair(real_data("kitti_velodyne").parent)
    error = se3.transform(se3.exp_so3([0.0, 0.0, np.radians(2.0)]), [1.2, 0.7, 0.3])
    wrong = error @ T
    grid = GridGeometry.aligned("site", 0.2, (-20.0, -20.0, 20.0, 20.0))
    good = cells_of("good", target, 0.03, grid)
    bad = cells_of("bad", source @ wrong[:3, :3].T + wrong[:3, 3], 0.08, grid)
    agreements = compare_robots([bad, good])
    fused = fuse_robots([bad, good], agreements)
    both = good.assembled.statistics.observed & bad.assembled.statistics.observed
    change_m = np.abs(fused.statistics.mean - good.assembled.statistics.mean)[both]
    assert np.median(change_m) == 0.0
    assert np.percentile(change_m, 90) < 0.05
    registration = agreements[0].registration
    assert registration is not None
    left = registration.T @ error
    assert np.linalg.norm(left[:3, 3]) < 0.06
    assert abs(np.degrees(np.arctan2(left[1, 0], left[0, 0]))) < 0.3
