# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Masked correlation of gradients over translations and rotations, with refinement of peaks."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
from pydantic import Field
from scipy import fft
from scipy.ndimage import map_coordinates

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import GridGeometry, horn_gradient
from cdff_core.dfns.raster_matching._correlation import correlation, field
from cdff_core.dfns.raster_matching._refinement import Ground, place
from cdff_core.dfns.raster_matching.interface import Inputs, Interface, Outputs

#: Minimum distance of peaks and of candidates, cells.
_APART_CELLS = 3.0
#: Fraction of a reference cell that the template's cells must cover for it to have a height.
_COVERED = 0.25
#: Largest displacement of a candidate by refinement, cells.
_MOST_MOVED = 3.5
#: Upper bound of the explained fraction, above which differences are rounding noise.
_MOST_EXPLAINED = 0.9999
#: Minimum number of cells observed in both maps.
_MIN_CELLS = 80
#: Number of cells of correlated noise.
_CELLS_PER_SAMPLE = 12.0


class MaskedGradientCorrelationConfig(DfnConfig):
    """Parameters of MaskedGradientCorrelation."""

    search_m: float = Field(30.0, gt=0, le=100_000, description="Largest distance from the guess searched")
    search_deg: float = Field(10.0, ge=0, le=180, description="Largest rotation from the guess searched")
    candidates: int = Field(12, ge=1, le=64, description="Number of peaks that are refined")
    min_overlap: float = Field(
        0.7, gt=0, le=1, description="Minimum fraction of the template on the reference"
    )
    min_relief: float = Field(0.01, ge=0, le=10, description="Minimum root mean square slope about its mean")
    covariance_inflation: float = Field(1.0, gt=0, le=1000, description="Calibrated factor on the covariance")
    floor_cells: float = Field(
        0.001,
        ge=0,
        le=10,
        description="Standard deviation of the translation due to interpolation, added to that of the fit",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    """Points of the template rotated by one yaw and resampled on the reference's cells about the guessed
    middle.

    ``row``, ``col``, ``z_m`` (n,) are means of the points of each cell, cells of the window and metres;
    ``gradient`` is a grid whose cell (0, 0) is cell ``corner`` of the window.
    """

    yaw_rad: float
    row: FloatArray
    col: FloatArray
    z_m: FloatArray
    cells: tuple[IntArray, IntArray]
    corner: tuple[int, int]
    gradient: tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    transform: FloatArray
    covariance: FloatArray
    correlation: float
    explained: float
    cells: int


class MaskedGradientCorrelation(Interface[MaskedGradientCorrelationConfig]):
    """Correlation of the gradient fields of both maps, which is independent of offset and tilt, at all
    rotations.

    The template's heights are averaged over the reference's cells for each rotation. Peaks are refined by
    least squares of the heights, with free offset and tilt. The likelihood of a candidate follows from the
    fraction of the template's relief that the reference explains: places with similar slopes by chance rarely
    have the same heights.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the candidates, best first; raises InputError or RefusedError."""
        c = self.config
        points, centre = _points(inputs)
        guess = np.eye(4) if inputs.guess is None else np.asarray(inputs.guess, dtype=np.float64)
        reach_m, reach_rad = (c.search_m, np.radians(c.search_deg)) if inputs.reach is None else inputs.reach
        geometry = inputs.reference.geometry
        middle = (guess[:3, :3] @ centre + guess[:3, 3])[:2]
        radius_m = float(np.quantile(np.linalg.norm(points[:, :2] - centre[:2], axis=1), 0.95))
        window, heights = _window(
            inputs, middle, float(reach_m) + 1.3 * radius_m + 3.0 * geometry.resolution_m
        )
        reference = _gradient(heights, window.resolution_m)
        yaw = float(np.arctan2(guess[1, 0], guess[0, 0]))
        per_cell = (geometry.resolution_m / inputs.template.geometry.resolution_m) ** 2
        turns = _rotations(float(reach_rad), min(geometry.resolution_m / radius_m, 0.5))
        templates = [
            _resampled(points, centre, yaw + turn, middle, window, _COVERED * per_cell) for turn in turns
        ]
        level = templates[len(templates) // 2]
        self._check(level)
        reach = max(1, ceil(float(reach_m) / window.resolution_m))
        volume = self._surfaces(templates, reference, reach)
        if not np.isfinite(volume).any():
            raise RefusedError(f"no {c.min_overlap:.0%} of the template lies on the reference", ("outside",))
        ground = Ground.of(heights)
        found: list[_Candidate] = []
        for turn, row, col in _peaks(volume, c.candidates):
            shift = (row - reach, col - reach)
            candidate = self._refined(templates[turn], shift, ground, reference, window, middle, centre)
            if candidate is not None:
                _add_candidate(found, candidate, centre, window.resolution_m)
        if not found:
            raise RefusedError("no gradient peak is confirmed by the heights", ("no_peak",))
        return self._outputs(sorted(found, key=lambda one: -one.explained), centre)

    def _check(self, level: _Template) -> None:
        c = self.config
        seen = np.isfinite(level.gradient[0])
        cells = int(np.count_nonzero(seen))
        if cells < _MIN_CELLS:
            raise RefusedError(
                f"{cells} cells with a gradient, expected at least {_MIN_CELLS}", ("little_seen",)
            )
        relief = float(np.sqrt(sum(np.var(g[seen]) for g in level.gradient)))
        self.metrics = {"cells": cells, "relief": relief}
        if relief < c.min_relief:
            raise RefusedError(
                f"slope {relief:.4f} about its mean, expected at least {c.min_relief}", ("flat",)
            )

    def _surfaces(
        self, templates: list[_Template], reference: tuple[FloatArray, FloatArray], reach: int
    ) -> FloatArray:
        """Return correlations ``(rotations, 2 reach + 1, 2 reach + 1)`` over rows and columns."""
        rows, cols = reference[0].shape
        most = [max(t.gradient[0].shape[k] for t in templates) for k in (0, 1)]
        shape = (fft.next_fast_len(rows + most[0], real=True), fft.next_fast_len(cols + most[1], real=True))
        searched = field(reference, shape)
        shifts = np.arange(-reach, reach + 1)
        surfaces = []
        for t in templates:
            cells = int(np.count_nonzero(np.isfinite(t.gradient[0])))
            least = max(self.config.min_overlap * cells, float(min(_MIN_CELLS, cells)))
            surface = correlation(field(t.gradient, shape), searched, shape, least)
            surfaces.append(
                surface[np.ix_((shifts + t.corner[0]) % shape[0], (shifts + t.corner[1]) % shape[1])]
            )
        return np.stack(surfaces)

    def _refined(
        self,
        template: _Template,
        shift: tuple[int, int],
        ground: Ground,
        reference: tuple[FloatArray, FloatArray],
        window: GridGeometry,
        middle: FloatArray,
        centre: FloatArray,
    ) -> _Candidate | None:
        """Return a refined peak: T_reference_template, with covariance and correlation."""
        config, c = self.config, window.resolution_m
        at = (
            (window.ymax_m - middle[1]) / c - 0.5 + shift[0],
            (middle[0] - window.xmin_m) / c - 0.5 + shift[1],
        )
        placed = place(ground, template.row + shift[0], template.col + shift[1], template.z_m, at)
        if placed is None or np.hypot(placed.row, placed.col) > _MOST_MOVED:
            return None
        value = _correlation_at(template, shift, (placed.row, placed.col, placed.turn_rad), at, reference)
        x = window.xmin_m + (at[1] + placed.col + 0.5) * c
        y = window.ymax_m - (at[0] + placed.row + 0.5) * c
        R = se3.exp_so3(np.array([0.0, 0.0, template.yaw_rad + placed.turn_rad]))
        x, y = np.array([x, y]) - (R @ centre)[:2]
        pose = se3.transform(R, np.array([x, y, placed.height_m]))
        scale = np.array([c, -c, 1.0, 1.0])
        covariance = config.covariance_inflation * placed.covariance * np.outer(scale, scale)
        covariance += np.diag([(config.floor_cells * c) ** 2] * 2 + [0.0, 0.0])
        explained = 1.0 - (placed.residual_m / placed.relief_m) ** 2 if placed.relief_m > 0.0 else 0.0
        return _Candidate(pose, covariance, value, explained, placed.cells)

    def _outputs(self, found: list[_Candidate], centre: FloatArray) -> Outputs:
        explained = np.array([one.explained for one in found])
        # Profile likelihood of heights about the reference, with unknown noise that is correlated within some
        # cells.
        samples = np.array([one.cells for one in found]) / _CELLS_PER_SAMPLE
        bounded = np.clip(explained, None, _MOST_EXPLAINED)
        self.metrics = {**self.metrics, "explained": float(explained[0]), "correlation": found[0].correlation}
        return Outputs(
            transforms=np.stack([one.transform for one in found]),
            covariances=np.stack([one.covariance for one in found]),
            correlations=np.array([one.correlation for one in found]),
            explained=explained,
            log_likelihoods=-0.5 * samples.max() * np.log1p(-bounded),
            centre=centre,
        )


def _points(inputs: Inputs) -> tuple[FloatArray, FloatArray]:
    """Return centres and heights of the template's observed cells ``(n, 3)``, and their middle ``(3,)``."""
    template, reference = inputs.template.geometry, inputs.reference.geometry
    if template.resolution_m > reference.resolution_m * (1.0 + 1e-9):
        raise InputError(
            f"template in cells of {template.resolution_m} m: expected at most the reference's "
            f"{reference.resolution_m}"
        )
    z = inputs.template.layer("mean").astype(np.float64)
    seen = np.isfinite(z)
    if not seen.any():
        raise RefusedError("the template has no observed cell", ("little_seen",))
    x, y = template.centres_m()
    points = np.column_stack([x[seen], y[seen], z[seen]])
    return points, points.mean(axis=0)


def _window(inputs: Inputs, middle: FloatArray, reach_m: float) -> tuple[GridGeometry, FloatArray]:
    """Return the part of the reference within reach of the middle, with its heights."""
    geometry = inputs.reference.geometry
    bounds = (middle[0] - reach_m, middle[1] - reach_m, middle[0] + reach_m, middle[1] + reach_m)
    wanted = GridGeometry.aligned(geometry.frame, geometry.resolution_m, bounds)
    window = geometry.intersection(wanted)
    if window is None or min(window.shape) < 3:
        raise RefusedError(f"nothing of the reference within {reach_m:.0f} m of the guess", ("outside",))
    heights = inputs.reference.layer("mean")[geometry.slices_of(window)].astype(np.float64)
    if not np.isfinite(heights).any():
        raise RefusedError(
            f"nothing of the reference is observed within {reach_m:.0f} m of the guess", ("outside",)
        )
    return window, heights


def _rotations(reach_rad: float, step_rad: float) -> FloatArray:
    """Return rotations to test, symmetric about 0, at most a step apart."""
    count = ceil(reach_rad / step_rad)
    return np.linspace(-reach_rad, reach_rad, 2 * count + 1) if count else np.zeros(1)


def _resampled(
    points: FloatArray, centre: FloatArray, yaw: float, middle: FloatArray, window: GridGeometry, least: float
) -> _Template:
    """Return the template: mean position and height in each of the window's cells, with gradient."""
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
    mean_row, mean_col, z_m = (
        np.bincount(index, v, len(n))[kept] / n[kept] for v in (row, col, points[:, 2])
    )
    heights = np.full(len(n), np.nan)
    heights[kept] = z_m
    cells = (kept // shape[1], kept % shape[1])
    return _Template(
        yaw_rad=yaw,
        row=mean_row,
        col=mean_col,
        z_m=z_m,
        cells=cells,
        corner=corner,
        gradient=_gradient(heights.reshape(shape), cell),
    )


def _gradient(heights: FloatArray, cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Return both components, NaN where either is undefined."""
    x, y = horn_gradient(heights, cell_m)
    hole = np.isnan(x + y)
    return np.where(hole, np.nan, x), np.where(hole, np.nan, y)


def _peaks(volume: FloatArray, count: int) -> list[tuple[int, int, int]]:
    """Return the indices of the highest correlations, at least some cells apart for any rotation."""
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
    reference: tuple[FloatArray, FloatArray],
) -> float:
    """Return the correlation of the gradients at a position between cells; 0 without overlap."""
    gx, gy = (g[template.cells] for g in template.gradient)
    y, x = template.row + shift[0] - middle[0], template.col + shift[1] - middle[1]
    c, s = np.cos(moved[2]), np.sin(moved[2])
    at = np.stack([middle[0] + moved[0] + c * y - s * x, middle[1] + moved[1] + c * x + s * y])
    # NaN of an unobserved cell propagates to interpolated values, and cval to positions outside.
    hx, hy = (map_coordinates(g, at, order=1, cval=np.nan) for g in reference)
    usable = np.isfinite(gx) & np.isfinite(hx)
    if np.count_nonzero(usable) < 4:
        return 0.0
    a = np.stack([c * gx - s * gy, s * gx + c * gy])[:, usable]
    b = np.stack([hx, hy])[:, usable]
    a, b = (v - v.mean(axis=1, keepdims=True) for v in (a, b))
    norm = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum() / norm) if norm > 0.0 else 0.0


def _add_candidate(found: list[_Candidate], candidate: _Candidate, centre: FloatArray, cell_m: float) -> None:
    """Add a candidate; of two with the same position of the template's middle keep the better."""
    place = candidate.transform[:3, :3] @ centre + candidate.transform[:3, 3]
    for index, other in enumerate(found):
        between = place - (other.transform[:3, :3] @ centre + other.transform[:3, 3])
        if np.hypot(between[0], between[1]) <= _APART_CELLS * cell_m:
            if candidate.explained > other.explained:
                found[index] = candidate
            return
    found.append(candidate)
