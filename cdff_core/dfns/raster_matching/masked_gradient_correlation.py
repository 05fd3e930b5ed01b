# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Masked correlation of gradient images over shifts and turns; the best peaks refined below a cell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import fft
from scipy.ndimage import map_coordinates

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import GridGeometry, horn_gradient
from cdff_core.dfns.raster_matching._correlation import correlation, field
from cdff_core.dfns.raster_matching._interface import (
    RasterMatchingInputs,
    RasterMatchingInterface,
    RasterMatchingOutputs,
)
from cdff_core.dfns.raster_matching._refinement import Ground, place

Float = NDArray[np.float64]

#: Cells around a peak within which no other is taken; candidates that end so close are one.
_APART_CELLS = 3.0
#: Share of a reference cell that the template's cells must cover for it to have a height.
_COVERED = 0.25
#: A candidate that refinement moves farther than this, cells, was no peak of the heights.
_MOST_MOVED = 3.5
#: A share explained above it says no more: rounding is not evidence.
_MOST_EXPLAINED = 0.9999


class MaskedGradientCorrelationConfig(DfnConfig):
    """How far is searched, and what there must be to compare."""

    search_m: float = Field(30.0, gt=0.0, le=100_000.0, description="Distance from the guess, metres")
    search_deg: float = Field(10.0, ge=0.0, le=180.0, description="Turn from the guess, degrees")
    candidates: int = Field(12, ge=1, le=64, description="Peaks that are refined")
    min_cells: int = Field(80, ge=25, le=1_000_000, description="Cells of the reference that are observed in both")
    min_overlap: float = Field(0.7, gt=0.0, le=1.0, description="Share of the template on observed reference cells")
    min_relief: float = Field(0.01, ge=0.0, le=10.0, description="Root mean square slope about its mean, flat below")
    covariance_inflation: float = Field(1.0, gt=0.0, le=1000.0, description="Factor on the refinement's covariance")
    cells_per_sample: float = Field(12.0, ge=1.0, le=1000.0, description="Cells within which noise of heights is alike")
    floor_cells: float = Field(0.02, ge=0.0, le=10.0, description="Least standard deviation of the shift, cells")


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    """Points of the template turned by one yaw and laid on the reference's cells about the guessed middle.

    ``row``, ``col``, ``z_m`` (n,) are means of the points of each cell, cells of the window and metres; ``gradient`` is
    a grid whose cell (0, 0) is cell ``corner`` of the window.
    """

    yaw_rad: float
    row: Float
    col: Float
    z_m: Float
    cells: tuple[NDArray[np.int64], NDArray[np.int64]]
    corner: tuple[int, int]
    gradient: tuple[Float, Float]


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    transform: Float
    covariance: Float
    correlation: float
    explained: float
    cells: int


class MaskedGradientCorrelation(RasterMatchingInterface):
    """The template's heights are averaged over the reference's cells, once for each turn; gradients do not see heights.

    The correlation of two gradient fields about their means sees neither an offset nor a tilt of either map. A peak is
    refined by least squares of the heights themselves, offset and tilt free. How likely a candidate is follows from
    what share of the template's relief the reference explains there: places whose slopes are alike by chance seldom
    have its heights.
    """

    Config: ClassVar[type[DfnConfig]] = MaskedGradientCorrelationConfig

    def process(self, inputs: RasterMatchingInputs) -> RasterMatchingOutputs:
        """Return the candidates, best first; raises InputError, or RefusedError with little_seen, flat or outside."""
        c = self.config
        points, centre = _points(inputs)
        guess = np.eye(4) if inputs.guess is None else np.asarray(inputs.guess, dtype=np.float64)
        reach_m, reach_rad = (c.search_m, np.radians(c.search_deg)) if inputs.reach is None else inputs.reach
        geometry = inputs.reference.geometry
        middle = (guess[:3, :3] @ centre + guess[:3, 3])[:2]
        radius_m = float(np.quantile(np.linalg.norm(points[:, :2] - centre[:2], axis=1), 0.95))
        window, heights = _window(inputs, middle, float(reach_m) + 1.3 * radius_m + 3.0 * geometry.resolution_m)
        reference = _gradient(heights, window.resolution_m)
        yaw = float(np.arctan2(guess[1, 0], guess[0, 0]))
        per_cell = (geometry.resolution_m / inputs.template.geometry.resolution_m) ** 2
        turns = _turns(float(reach_rad), min(geometry.resolution_m / radius_m, 0.5))
        templates = [_laid(points, centre, yaw + turn, middle, window, _COVERED * per_cell) for turn in turns]
        level = templates[len(templates) // 2]
        self._check(level)
        reach = max(1, ceil(float(reach_m) / window.resolution_m))
        volume = self._surfaces(templates, reference, reach)
        if not np.isfinite(volume).any():
            raise RefusedError(f"no {c.min_overlap:.0%} of the template lies on the reference", ("outside",))
        ground = Ground.of(heights)
        found: list[_Candidate] = []
        for turn, row, col in _peaks(volume, c.candidates):
            candidate = self._refined(templates[turn], (row - reach, col - reach), ground, reference, window, middle)
            if candidate is not None:
                candidate = replace(candidate, transform=self._transform(candidate, centre))
                _keep(found, candidate, centre, window.resolution_m)
        if not found:
            raise RefusedError("no peak of the gradients is one of the heights", ("no_peak",))
        return self._outputs(sorted(found, key=lambda one: -one.explained), centre)

    def _check(self, level: _Template) -> None:
        c = self.config
        seen = np.isfinite(level.gradient[0])
        cells = int(np.count_nonzero(seen))
        if cells < c.min_cells:
            raise RefusedError(f"{cells} cells with a gradient, expected at least {c.min_cells}", ("little_seen",))
        relief = float(np.sqrt(sum(np.var(g[seen]) for g in level.gradient)))
        self.metrics = {"cells": cells, "relief": relief}
        if relief < c.min_relief:
            raise RefusedError(f"slope {relief:.4f} about its mean, expected at least {c.min_relief}", ("flat",))

    def _surfaces(self, templates: list[_Template], reference: tuple[Float, Float], reach: int) -> Float:
        """Correlations ``(turns, 2 reach + 1, 2 reach + 1)`` at shifts of rows and columns."""
        rows, cols = reference[0].shape
        most = [max(t.gradient[0].shape[k] for t in templates) for k in (0, 1)]
        shape = (fft.next_fast_len(rows + most[0], real=True), fft.next_fast_len(cols + most[1], real=True))
        searched = field(reference, shape)
        shifts = np.arange(-reach, reach + 1)
        surfaces = []
        for t in templates:
            cells = np.count_nonzero(np.isfinite(t.gradient[0]))
            least = max(self.config.min_overlap * cells, min(self.config.min_cells, cells))
            surface = correlation(field(t.gradient, shape), searched, shape, least)
            surfaces.append(surface[np.ix_((shifts + t.corner[0]) % shape[0], (shifts + t.corner[1]) % shape[1])])
        return np.stack(surfaces)

    def _refined(
        self,
        template: _Template,
        shift: tuple[int, int],
        ground: Ground,
        reference: tuple[Float, Float],
        window: GridGeometry,
        middle: Float,
    ) -> _Candidate | None:
        """A peak below a cell: T_reference of the middle, with covariance and correlation there."""
        r, c = self.config, window.resolution_m
        at = ((window.ymax_m - middle[1]) / c - 0.5 + shift[0], (middle[0] - window.xmin_m) / c - 0.5 + shift[1])
        placed = place(ground, template.row + shift[0], template.col + shift[1], template.z_m, at)
        if placed is None or np.hypot(placed.row, placed.col) > _MOST_MOVED:
            return None
        value = _correlation_at(template, shift, (placed.row, placed.col, placed.turn_rad), at, reference)
        x = window.xmin_m + (at[1] + placed.col + 0.5) * c
        y = window.ymax_m - (at[0] + placed.row + 0.5) * c
        pose = se3.transform(se3.exp_so3(np.array([0.0, 0.0, template.yaw_rad + placed.turn_rad])),
                             np.array([x, y, placed.height_m]))  # fmt: skip
        scale = np.array([c, -c, 1.0, 1.0])
        covariance = r.covariance_inflation * placed.covariance * np.outer(scale, scale)
        covariance += np.diag([(r.floor_cells * c) ** 2] * 2 + [0.0, 0.0])
        explained = 1.0 - (placed.residual_m / placed.relief_m) ** 2 if placed.relief_m > 0.0 else 0.0
        return _Candidate(pose, covariance, value, explained, placed.cells)

    def _transform(self, candidate: _Candidate, centre: Float) -> Float:
        """T_reference_template from where the template's middle came to lie."""
        R, t = candidate.transform[:3, :3], candidate.transform[:3, 3].copy()
        t[:2] -= (R @ centre)[:2]
        return se3.transform(R, t)

    def _outputs(self, found: list[_Candidate], centre: Float) -> RasterMatchingOutputs:
        explained = np.array([one.explained for one in found])
        # Profile likelihood of heights about the reference, their noise unknown and alike within some cells.
        samples = np.array([one.cells for one in found]) / self.config.cells_per_sample
        bounded = np.clip(explained, None, _MOST_EXPLAINED)
        self.metrics = {**self.metrics, "explained": float(explained[0]), "correlation": found[0].correlation}
        return RasterMatchingOutputs(
            transforms=np.stack([one.transform for one in found]),
            covariances=np.stack([one.covariance for one in found]),
            correlations=np.array([one.correlation for one in found]), explained=explained,
            log_likelihoods=-0.5 * samples.max() * np.log1p(-bounded), centre=centre,
        )  # fmt: skip


def _points(inputs: RasterMatchingInputs) -> tuple[Float, Float]:
    """Centres and heights of the template's observed cells ``(n, 3)``, and their middle ``(3,)``."""
    template, reference = inputs.template.geometry, inputs.reference.geometry
    if template.resolution_m > reference.resolution_m * (1.0 + 1e-9):
        raise InputError(
            f"template in cells of {template.resolution_m} m: expected at most the reference's {reference.resolution_m}"
        )
    z = inputs.template.layer("mean").astype(np.float64)
    seen = np.isfinite(z)
    if not seen.any():
        raise RefusedError("the template has no observed cell", ("little_seen",))
    x, y = template.centres_m()
    points = np.column_stack([x[seen], y[seen], z[seen]])
    return points, points.mean(axis=0)


def _window(inputs: RasterMatchingInputs, middle: Float, reach_m: float) -> tuple[GridGeometry, Float]:
    """The part of the reference within reach of the middle, with its heights."""
    geometry = inputs.reference.geometry
    bounds = (middle[0] - reach_m, middle[1] - reach_m, middle[0] + reach_m, middle[1] + reach_m)
    wanted = GridGeometry.aligned(geometry.frame, geometry.resolution_m, bounds)
    window = geometry.intersection(wanted)
    if window is None or min(window.shape) < 3:
        raise RefusedError(f"nothing of the reference within {reach_m:.0f} m of the guess", ("outside",))
    heights = inputs.reference.layer("mean")[geometry.slices_of(window)].astype(np.float64)
    if not np.isfinite(heights).any():
        raise RefusedError(f"nothing of the reference is observed within {reach_m:.0f} m of the guess", ("outside",))
    return window, heights


def _turns(reach_rad: float, step_rad: float) -> Float:
    """Turns to try, symmetric about 0, at most a step apart."""
    count = ceil(reach_rad / step_rad)
    return np.linspace(-reach_rad, reach_rad, 2 * count + 1) if count else np.zeros(1)


def _laid(points: Float, centre: Float, yaw: float, middle: Float, window: GridGeometry, least: float) -> _Template:
    """Mean place and height of the points in each of the window's cells (also beyond its edges), and their gradient."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = points[:, 0] - centre[0], points[:, 1] - centre[1]
    cell = window.resolution_m
    col = (cos * x - sin * y + middle[0] - window.xmin_m) / cell - 0.5
    row = (window.ymax_m - (sin * x + cos * y + middle[1])) / cell - 0.5
    r, c = np.rint(row).astype(np.int64), np.rint(col).astype(np.int64)
    corner = (int(r.min()), int(c.min()))
    r, c = r - corner[0], c - corner[1]
    shape = (int(r.max()) + 1, int(c.max()) + 1)
    index = r * shape[1] + c
    n = np.bincount(index, minlength=shape[0] * shape[1])
    kept = np.flatnonzero(n >= max(least, 1.0))
    mean = [np.bincount(index, v, len(n))[kept] / n[kept] for v in (row, col, points[:, 2])]
    heights = np.full(len(n), np.nan)
    heights[kept] = mean[2]
    cells = (kept // shape[1], kept % shape[1])
    return _Template(yaw, *mean, cells, corner, _gradient(heights.reshape(shape), cell))


def _gradient(heights: Float, cell_m: float) -> tuple[Float, Float]:
    """Both components, NaN where either is."""
    x, y = horn_gradient(heights, cell_m)
    hole = np.isnan(x + y)
    return np.where(hole, np.nan, x), np.where(hole, np.nan, y)


def _peaks(volume: Float, count: int) -> list[tuple[int, int, int]]:
    """Indices of the highest correlations, no two within some cells of one another whatever their turn."""
    best = np.nan_to_num(volume, nan=-2.0)
    flat, turn = best.max(axis=0), best.argmax(axis=0)
    rows, cols = np.indices(flat.shape)
    found = []
    for _ in range(count):
        row, col = np.unravel_index(int(flat.argmax()), flat.shape)
        if flat[row, col] <= 0.0:
            break
        found.append((int(turn[row, col]), int(row), int(col)))
        flat[np.hypot(rows - row, cols - col) <= _APART_CELLS] = -2.0
    return found


def _correlation_at(
    template: _Template,
    shift: tuple[int, int],
    moved: tuple[float, float, float],
    middle: tuple[float, float],
    reference: tuple[Float, Float],
) -> float:
    """Correlation of the gradients at a place between the cells; 0 where they do not meet."""
    gx, gy = (g[template.cells] for g in template.gradient)
    y, x = template.row + shift[0] - middle[0], template.col + shift[1] - middle[1]
    c, s = np.cos(moved[2]), np.sin(moved[2])
    at = np.stack([middle[0] + moved[0] + c * y - s * x, middle[1] + moved[1] + c * x + s * y])
    # NaN of an unobserved cell spreads to what is interpolated from it, and cval to what lies outside.
    hx, hy = (map_coordinates(g, at, order=1, cval=np.nan) for g in reference)
    usable = np.isfinite(gx) & np.isfinite(hx)
    if np.count_nonzero(usable) < 4:
        return 0.0
    a = np.stack([c * gx - s * gy, s * gx + c * gy])[:, usable]
    b = np.stack([hx, hy])[:, usable]
    a, b = (v - v.mean(axis=1, keepdims=True) for v in (a, b))
    norm = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum() / norm) if norm > 0.0 else 0.0


def _keep(found: list[_Candidate], candidate: _Candidate, centre: Float, cell_m: float) -> None:
    """Add a candidate; of two that put the template's middle at one place the better stays."""
    place = candidate.transform[:3, :3] @ centre + candidate.transform[:3, 3]
    for index, other in enumerate(found):
        between = place - (other.transform[:3, :3] @ centre + other.transform[:3, 3])
        if np.hypot(between[0], between[1]) <= _APART_CELLS * cell_m:
            if candidate.explained > other.explained:
                found[index] = candidate
            return
    found.append(candidate)
