# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fusion of the maps of several robots by the variance of their error.

The maps of one robot share its localisation error, which does not decrease with the number of heights: they
are pooled, and the error variance of a pooled cell is that of ``auxiliary_layers``. The errors of different
robots are independent: a cell is the mean of the robots' cells, weighted by the inverse of the variance.

Stated variances can be too small. Robots are compared in their common cells; the variance of a robot that
differs from a more certain one by more than both state is increased by the excess. In each cell, a robot that
nevertheless differs from the most certain one by more than three standard deviations, or that has less than
5 % of the weight, does not contribute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.auxiliary_layers import (
    AREA_SUM,
    COUNT_SQUARES,
    FIRST_US,
    INTENSITY_COUNT,
    INTENSITY_SUM,
    OVERHANG_M,
    POSE_VARIANCE_SUM,
    X_SUM,
    Y_SUM,
    AuxiliaryLayers,
)
from cdff_common.raster.height_registration import HeightRegistration, register_heights
from cdff_common.raster.mosaic import AGREED_M, DISAGREE_SIGMA, AssembledWindow
from cdff_common.raster.statistics import CellStatistics

Grid = NDArray[np.float64]

#: Smallest weight of a robot in a cell.
SMALLEST_SHARE = 0.05
#: Fewest common cells of a comparison.
FEWEST_CELLS = 30
#: A robot differs if the median of its squared differences exceeds this multiple of that expected.
_EXCESS = 4.0
#: Median of the chi-squared distribution with one degree of freedom.
_MEDIAN_CHI2 = 0.4549
#: Smallest standard deviation of a cell's error, metres.
_LEAST_SIGMA_M = 1e-3
#: Fraction of differing cells from which on a registration is searched for.
_DIFFERING_SHARE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class RobotCells:
    """Pooled cells of the maps of one robot."""

    robot: str
    assembled: AssembledWindow

    def error_variances(self) -> tuple[Grid, Grid]:
        """Return error variance and its part without the pose, (rows, cols); NaN where unknown."""
        cells, auxiliary = self.assembled.statistics, self.assembled.auxiliary
        if auxiliary is None:
            unknown = np.full(cells.geometry.shape, np.nan)
            return unknown, unknown
        layers = auxiliary.to_layers(cells, 0)
        total = layers["error_variance"].astype(np.float64)
        noise = np.maximum(total - layers["pose_variance"], 0.0)
        return np.maximum(total, _LEAST_SIGMA_M**2), np.maximum(noise, _LEAST_SIGMA_M**2)


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Comparison of the maps of a robot with those of more certain robots.

    Attributes
    ----------
    robot : str
    references : tuple of str
        More certain robots.
    cells : int
        Common cells.
    difference_m : float
        Median of the magnitudes of the height differences.
    differing : float
        Fraction of the common cells that differ by more than three standard deviations of their noise.
    excess_sigma_m : float
        Standard deviation that explains the differences beyond the stated variances; 0 if they agree.
    registration : HeightRegistration or None
        Transform of the robot's maps that would resolve the differences.
    """

    robot: str
    references: tuple[str, ...]
    cells: int
    difference_m: float
    differing: float
    excess_sigma_m: float
    registration: HeightRegistration | None

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON data, lengths in metres."""
        return {
            "robot": self.robot,
            "references": list(self.references),
            "cells": self.cells,
            "difference_m": self.difference_m,
            "differing": self.differing,
            "excess_sigma_m": self.excess_sigma_m,
            "registration": None if self.registration is None else self.registration.to_dict(),
        }


def compare_robots(parts: Sequence[RobotCells]) -> tuple[Agreement, ...]:
    """Compare the cells of each robot with the same cells of the more certain robots.

    The most certain robot has the smallest median error variance. A robot that differs from most of at least
    two others is less certain than they are, whatever it states.
    """
    heights = [np.where(p.assembled.statistics.observed, p.assembled.statistics.mean, np.nan) for p in parts]
    errors = [part.error_variances() for part in parts]
    order = _by_certainty(heights, [total for total, _ in errors])
    agreements = []
    if not order:
        return ()
    first = order[0]
    reference, variance, noise = heights[first].copy(), errors[first][0].copy(), errors[first][1].copy()
    before = [parts[first].robot]
    for i in order[1:]:
        mine, (my_variance, my_noise) = heights[i], errors[i]
        d2 = (mine - reference) ** 2
        known = np.isfinite(d2) & np.isfinite(my_variance) & np.isfinite(variance)
        cells, excess_m = int(np.count_nonzero(known)), 0.0
        if cells >= FEWEST_CELLS:
            squares, expected = d2[known], (my_variance + variance)[known]
            if np.median(squares / expected) > _EXCESS * _MEDIAN_CHI2:
                excess = np.median(squares) / _MEDIAN_CHI2 - np.median(expected)
                excess_m = float(np.sqrt(max(excess, 0.0)))
            differs = squares > np.maximum(DISAGREE_SIGMA**2 * (my_noise + noise)[known], AGREED_M**2)
            share = float(np.mean(differs))
            is_different = excess_m > 0.0 or share > _DIFFERING_SHARE
            geometry = parts[i].assembled.statistics.geometry
            registration = register_heights(geometry, reference, mine) if is_different else None
            median_m = float(np.sqrt(np.median(squares)))
            agreements.append(
                Agreement(parts[i].robot, tuple(before), cells, median_m, share, excess_m, registration)
            )
        # The reference of the next robot has, in each cell, the heights of the most certain one.
        total = my_variance + excess_m**2
        better = np.isfinite(mine) & ~(np.isfinite(reference) & ~(total < variance))
        for target, values in ((reference, mine), (variance, total), (noise, my_noise)):
            np.copyto(target, values, where=better)
        before.append(parts[i].robot)
    return tuple(agreements)


def fuse_robots(parts: Sequence[RobotCells], agreements: Sequence[Agreement]) -> AssembledWindow:
    """Return the fused cells of several robots on one grid.

    A cell in which the error variance of any robot is unknown contains all heights, pooled.
    """
    excess = {a.robot: a.excess_sigma_m**2 for a in agreements}
    statistics = [part.assembled.statistics for part in parts]
    count = np.stack([s.count for s in statistics])
    mean, m2 = np.stack([s.mean for s in statistics]), np.stack([s.m2 for s in statistics])
    errors = [part.error_variances() for part in parts]
    added = np.array([excess.get(part.robot, 0.0) for part in parts])[:, None, None]
    observed = count > 0.0
    variance = np.where(observed, np.stack([total for total, _ in errors]) + added, np.inf)
    noise = np.stack([part for _, part in errors])
    unknown = np.asarray((observed & np.isnan(variance)).any(axis=0), dtype=np.bool_)
    best = np.argmin(np.where(np.isnan(variance), np.inf, variance), axis=0)[None]
    d2 = (mean - np.take_along_axis(mean, best, 0)) ** 2
    pair = variance + np.take_along_axis(variance, best, 0)
    noise_pair = noise + np.take_along_axis(noise, best, 0)
    several = observed & (observed.sum(axis=0) > 1)
    with np.errstate(invalid="ignore"):
        excluded = several & (d2 > np.maximum(DISAGREE_SIGMA**2 * pair, AGREED_M**2))
        differing = several & (d2 > np.maximum(DISAGREE_SIGMA**2 * noise_pair, AGREED_M**2))
    weight = np.where(observed & ~excluded, 1.0 / np.where(observed, variance, 1.0), 0.0)
    weight = np.where(weight < SMALLEST_SHARE * weight.sum(axis=0), 0.0, weight)
    weight = np.where(unknown, count, weight)
    total = weight.sum(axis=0)
    share = weight / np.where(total > 0.0, total, 1.0)
    is_used = weight > 0.0
    fused_mean = (share * mean).sum(axis=0)
    spread = m2 / np.where(observed, count, 1.0) + (mean - fused_mean) ** 2
    fused_count = np.where(is_used, count, 0.0).sum(axis=0)
    between = np.where(is_used, count * (mean - fused_mean) ** 2, 0.0).sum(axis=0)
    within = np.where(is_used, m2, 0.0).sum(axis=0)
    pooled_flags = between > DISAGREE_SIGMA**2 * within + AGREED_M**2 * fused_count
    is_flagged = np.where(unknown, pooled_flags, differing.any(axis=0))
    is_flagged |= np.any([part.assembled.flagged for part in parts], axis=0)
    fused = CellStatistics(
        statistics[0].geometry,
        fused_count,
        fused_mean,
        np.where(is_used, share * spread, 0.0).sum(axis=0) * fused_count,
        np.where(is_used, np.stack([s.minimum for s in statistics]), np.inf).min(axis=0),
        np.where(is_used, np.stack([s.maximum for s in statistics]), -np.inf).max(axis=0),
        np.where(is_used, np.stack([s.newest_ns for s in statistics]), np.iinfo(np.int64).min).max(axis=0),
    )
    auxiliary = _fused_auxiliary(parts, share, is_used, unknown, fused_count, added)
    return AssembledWindow(fused, auxiliary, is_flagged.astype(np.bool_))


def _fused_auxiliary(
    parts: Sequence[RobotCells],
    share: Grid,
    is_used: NDArray[np.bool_],
    unknown: NDArray[np.bool_],
    count: Grid,
    added: Grid,
) -> AuxiliaryLayers | None:
    """Return the auxiliary layers; the variance of the poses is that of the weighted mean."""
    if all(part.assembled.auxiliary is None for part in parts):
        return None
    layers = []
    for part in parts:
        cells = part.assembled.statistics
        layers.append(part.assembled.auxiliary or AuxiliaryLayers.unknown(cells.geometry, cells.observed))
    counts = np.stack([part.assembled.statistics.count for part in parts])
    sums = np.stack([layer.sums for layer in layers])
    result = AuxiliaryLayers.empty(layers[0].geometry)
    pose_sum = np.where(is_used, sums[..., POSE_VARIANCE_SUM], 0.0)
    pose = pose_sum / np.where(is_used, counts, 1.0) + added
    weighted = np.where(is_used, share**2 * pose, 0.0).sum(axis=0) * count
    result.sums[..., POSE_VARIANCE_SUM] = np.where(unknown, pose_sum.sum(axis=0), weighted)
    numbers = np.where(is_used, counts, 1.0)
    squares = np.where(is_used, share**2 * sums[..., COUNT_SQUARES] / numbers**2, 0.0).sum(axis=0)
    area = np.where(is_used, share * sums[..., AREA_SUM] / numbers, 0.0).sum(axis=0)
    result.sums[..., COUNT_SQUARES], result.sums[..., AREA_SUM] = squares * count**2, area * count
    for coordinate in (X_SUM, Y_SUM):
        means = np.where(is_used, share * sums[..., coordinate] / numbers, 0.0)
        result.sums[..., coordinate] = means.sum(axis=0) * count
    for added_up in (INTENSITY_SUM, INTENSITY_COUNT):
        result.sums[..., added_up] = np.where(is_used, sums[..., added_up], 0.0).sum(axis=0)
    for lowest in (FIRST_US, OVERHANG_M):
        result.sums[..., lowest] = np.where(is_used, sums[..., lowest], np.inf).min(axis=0)
    return result


def _by_certainty(heights: Sequence[Grid], variances: Sequence[Grid]) -> list[int]:
    """Return the robots with known errors, the most certain one first."""
    medians = {}
    for i, (height, variance) in enumerate(zip(heights, variances, strict=True)):
        known_variances = variance[np.isfinite(height) & np.isfinite(variance)]
        if len(known_variances):
            medians[i] = float(np.median(known_variances))
    is_alone = dict.fromkeys(medians, False)
    for i in medians:
        differs = []
        for j in medians:
            ratio = (heights[i] - heights[j]) ** 2 / (variances[i] + variances[j])
            ratio = ratio[np.isfinite(ratio)]
            if i != j and len(ratio) >= FEWEST_CELLS:
                differs.append(float(np.median(ratio)) > _EXCESS * _MEDIAN_CHI2)
        is_alone[i] = len(differs) >= 2 and sum(differs) > len(differs) / 2
    return sorted(medians, key=lambda i: (is_alone[i], medians[i], i))
