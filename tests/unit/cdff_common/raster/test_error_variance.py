# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stated errors of heights in cells that are larger than those of the map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.raster.auxiliary_layers import POSE_VARIANCE_SUM, AuxiliaryLayers
from cdff_common.raster.mosaic import Mosaic
from cdff_common.raster.resample import aggregate

FINE_M = 0.1
RANGE_SIGMA_M = 0.02


def fine_map(points_m: np.ndarray, grid: GridGeometry) -> tuple[CellStatistics, AuxiliaryLayers]:
    """Return the statistics of points ``(n, 3)`` with range noise."""
    stamps, variance = np.zeros(1, np.int64), np.full(len(points_m), RANGE_SIGMA_M**2)
    statistics = CellStatistics.from_points(grid, points_m, stamps_ns=stamps, height_variance_m2=variance)
    auxiliary = AuxiliaryLayers.empty(grid)
    auxiliary.set_counts(statistics.count)
    return statistics, auxiliary


def stated_variance(fine: tuple[CellStatistics, AuxiliaryLayers], factor: int) -> np.ndarray:
    """Return the layer ``error_variance`` in larger cells."""
    statistics, auxiliary = fine
    return auxiliary.coarsened(factor).to_layers(aggregate(statistics, factor), 0)["error_variance"]


@pytest.mark.parametrize("observed", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("window", ["coarsened", "mosaic"])
def test_the_error_of_heights_sampled_in_clusters_is_stated(
    rng: np.random.Generator, observed: float, window: str
) -> None:
    """Each cell of the map has its own height; the numbers of heights in the observed cells differ."""
    fine, factor = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 40.0, 40.0)), 8
    truth = rng.normal(0.0, 0.1, fine.shape)
    count = np.where(rng.random(fine.shape) < observed, rng.integers(1, 30, fine.shape), 0).astype(float)
    noise = 0.02 / np.sqrt(np.maximum(count, 1.0)) * rng.normal(size=fine.shape)
    mean = np.where(count > 0, truth + noise, 0.0)
    m2 = count * 0.02**2
    statistics = CellStatistics(fine, count, mean, m2, mean, mean, np.zeros(fine.shape, np.int64))
    auxiliary = AuxiliaryLayers.empty(fine)
    auxiliary.set_counts(count)
    coarse = aggregate(statistics, factor)
    if window == "coarsened":
        stated = stated_variance((statistics, auxiliary), factor)
    else:
        layers = statistics.to_layers(0) | auxiliary.to_layers(statistics, 0)
        mosaic = Mosaic(coarse.geometry, auxiliary=True)
        mosaic.add(fine, layers, 0)
        stated = mosaic.assembled().to_layers(0)["error_variance"]
    blocks = truth.reshape(coarse.geometry.rows, factor, -1, factor).mean(axis=(1, 3))
    error = (coarse.mean - blocks)[coarse.count > 0]
    ratio = np.sqrt(np.mean(error**2) / np.mean(stated[coarse.count > 0]))
    print(f"{observed:.0%} of the cells observed, {window}: error / stated standard deviation = {ratio:.2f}")
    assert 0.7 < ratio < 1.15


def test_a_cell_of_the_map_itself_has_no_sampling_error_between_cells() -> None:
    grid = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0))
    count, mean = np.full(grid.shape, 4.0), np.zeros(grid.shape)
    statistics = CellStatistics(grid, count, mean, count * 0.01, mean, mean, np.zeros(grid.shape, np.int64))
    auxiliary = AuxiliaryLayers.empty(grid)
    auxiliary.sums[..., POSE_VARIANCE_SUM] = count * 0.002
    unset = auxiliary.to_layers(statistics, 0)["error_variance"]
    auxiliary.set_counts(count)
    np.testing.assert_array_equal(auxiliary.to_layers(statistics, 0)["error_variance"], unset)
    np.testing.assert_allclose(unset, 0.002 + 0.008 / 4.0, rtol=1e-6)


@pytest.mark.parametrize("scan", ["000000", "000002", "000094"])
@pytest.mark.parametrize("factor", [5, 10, 20])
def test_errors_of_a_real_lidar_with_few_scan_lines_agree_with_its_other_lines(
    real_data: Callable[[str], Path], scan: str, factor: int
) -> None:
    """A quarter of the scan lines makes the map; the heights of the other lines are the reference.

    The other lines have errors of sampling, too. The heights of the lines of this lidar differ by up to some
    centimetres, which the error does not contain.
    """
    points = np.fromfile(real_data(f"kitti_velodyne/{scan}.bin"), np.float32).reshape(-1, 4)[:, :3]
    points = points[np.hypot(points[:, 0], points[:, 1]) < 20.0].astype(np.float64)
    grid = GridGeometry.aligned("site", FINE_M, (-20.0, -20.0, 20.0, 20.0))
    lowest = np.full((41, 41), np.inf)
    square = tuple((np.floor(points[:, :2]) + 20).astype(np.int64).T)
    np.minimum.at(lowest, square, points[:, 2])
    points = points[points[:, 2] < lowest[square] + 0.3]
    elevation_deg = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    is_mapped = np.floor((elevation_deg + 25.0) / 0.42).astype(np.int64) % 4 == 1
    fine = fine_map(points[is_mapped], grid)
    coarse, stated = aggregate(fine[0], factor), stated_variance(fine, factor)
    reference = fine_map(points[~is_mapped], grid)
    others, covered = aggregate(reference[0], factor), fraction_in_blocks(reference[0].count > 0, factor)
    use = (coarse.count > 0) & (others.count >= 20) & (covered > 0.3)
    error, reference_variance = (coarse.mean - others.mean)[use], stated_variance(reference, factor)[use]
    independent = sum(cells.m2[use] / cells.count[use] ** 2 for cells in (coarse, others))
    ratio = np.sqrt(np.mean(error**2 / (stated[use] + reference_variance)))
    ratio_independent = np.sqrt(np.mean(error**2 / independent))
    print(
        f"scan {scan}, {use.sum()} cells of {factor * FINE_M:.1f} m: error / stated standard deviation = "
        f"{ratio:.2f}; if all heights were independent {ratio_independent:.2f}"
    )
    assert 0.7 < ratio < 1.5
    assert ratio < 0.5 * ratio_independent


def fraction_in_blocks(mask: np.ndarray, factor: int) -> np.ndarray:
    """Return the fraction of the cells of a mask in each larger cell."""
    rows, cols = mask.shape
    return mask.reshape(rows // factor, factor, cols // factor, factor).mean(axis=(1, 3))


def observed_cells(pattern: str, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Return the mask of about a quarter of the cells: cells or lines at random, or every fourth line."""
    mask = np.zeros(shape, dtype=bool)
    if pattern == "random cells":
        return rng.random(shape) < 0.25
    if pattern == "every fourth line":
        mask[1::4] = True
    else:
        mask[rng.random(shape[0]) < 0.25] = True
    return mask


def fractal_ground(size: int, rng: np.random.Generator) -> np.ndarray:
    """Return heights ``(size, size)``, metres, with the spectrum k^-3 and a standard deviation of 0.5 m."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size)))
    frequency[0, 0] = 1.0
    heights = np.fft.ifft2(np.fft.fft2(rng.normal(size=(size, size))) * frequency**-1.5).real
    return np.asarray(0.5 * heights / heights.std())


#: Smallest and largest ratio of the error to the stated deviation. Lines at random distances are clusters of
#: cells with similar heights: the stated error contains the mean displacement of the lines only.
SAMPLED_LIMITS = {"random cells": (0.7, 1.1), "every fourth line": (0.55, 1.4), "random lines": (0.9, 1.6)}


@pytest.mark.parametrize("ground", ["mola", "fractal"])
@pytest.mark.parametrize("pattern", SAMPLED_LIMITS)
def test_errors_on_independent_grounds_with_known_heights(
    real_data: Callable[[str], Path], rng: np.random.Generator, ground: str, pattern: str
) -> None:
    """The grounds were not used to choose the stated error, and the heights of all cells are known.

    ``mola`` is the topography of Mars between 50 degrees north and south, whose pixels are the cells.
    """
    if ground == "mola":
        raster = np.fromfile(real_data("planetary_rasters/megt90n000cb.img"), ">i2").reshape(720, 1440)
        truth, noise_m, cell_m = raster[160:560].astype(float), 1.0, 1.0
    else:
        truth, noise_m, cell_m = fractal_ground(800, rng), RANGE_SIGMA_M, FINE_M
    rows, cols = truth.shape
    grid = GridGeometry.aligned("site", cell_m, (0.0, 0.0, cols * cell_m, rows * cell_m))
    is_observed = observed_cells(pattern, truth.shape, rng)
    count = np.where(is_observed, rng.integers(1, 30, truth.shape), 0).astype(float)
    noise = noise_m / np.sqrt(np.maximum(count, 1.0)) * rng.normal(size=truth.shape)
    mean = np.where(is_observed, truth + noise, 0.0)
    stamps = np.zeros(grid.shape, np.int64)
    statistics = CellStatistics(grid, count, mean, count * noise_m**2, mean, mean, stamps)
    auxiliary = AuxiliaryLayers.empty(grid)
    auxiliary.set_counts(count)
    ratios = []
    for factor in (5, 10, 20):
        coarse, stated = aggregate(statistics, factor), stated_variance((statistics, auxiliary), factor)
        blocks = truth.reshape(rows // factor, factor, cols // factor, factor).mean(axis=(1, 3))
        use = coarse.count > 0
        ratios.append(float(np.sqrt(np.mean((coarse.mean - blocks)[use] ** 2 / stated[use]))))
    texts = ", ".join(f"{ratio:.2f}" for ratio in ratios)
    print(f"{ground}, {pattern}, 5, 10 and 20 cells: error / stated standard deviation = {texts}")
    smallest, largest = SAMPLED_LIMITS[pattern]
    assert smallest < min(ratios)
    assert max(ratios) < largest
