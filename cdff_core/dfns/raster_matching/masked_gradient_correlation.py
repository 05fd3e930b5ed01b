# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Masked correlation of gradients over translations and rotations, with refinement of the peaks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from pydantic import Field
from scipy import fft
from scipy.ndimage import map_coordinates

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import GridGeometry, horn_gradient
from cdff_common.raster.resample import area_means
from cdff_common.types import ElevationMap
from cdff_core.dfns.raster_matching._correlation import correlation, transform_field
from cdff_core.dfns.raster_matching._refinement import HeightSurface, Placement, refine_placement
from cdff_core.dfns.raster_matching.interface import Inputs, Interface, Outputs

#: Minimum distance between peaks and between candidates, cells.
_MIN_DISTANCE_CELLS = 3.0
#: Minimum fraction of a reference cell that observed cells of the template cover.
_MIN_COVERED = 0.25
#: Largest displacement of a candidate by the refinement, cells.
_MAX_REFINEMENT_CELLS = 3.5
#: Upper bound of the explained fraction in the likelihood; larger values differ only by rounding errors.
_MAX_EXPLAINED = 0.9999
#: Minimum number of cells observed in both maps.
_MIN_CELLS = 80
#: Number of cells with correlated noise, which count as one sample.
_CELLS_PER_SAMPLE = 12.0


class MaskedGradientCorrelationConfig(DfnConfig):
    """Parameters of MaskedGradientCorrelation."""

    search_m: float = Field(30.0, gt=0, le=100_000, description="Largest distance from the guess searched")
    search_deg: float = Field(10.0, ge=0, le=180, description="Largest rotation from the guess searched")
    candidates: int = Field(12, ge=1, le=64, description="Number of peaks that are refined")
    min_overlap: float = Field(
        0.7, gt=0, le=1, description="Minimum fraction of the template that lies on the reference"
    )
    min_relief: float = Field(
        0.001, ge=0, le=10, description="Minimum root mean square deviation of the slope from its mean"
    )
    covariance_inflation: float = Field(1.0, gt=0, le=1000, description="Calibrated factor on the covariance")
    floor_cells: float = Field(
        0.001,
        ge=0,
        le=10,
        description="Standard deviation of the translation due to interpolation, added to that of the fit",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    """Template rotated by one yaw and resampled to the cells of the window, with its middle at the guessed
    position.

    ``row``, ``col`` (cells of the window) and ``z_m`` (n,) are the mean position and height in each cell;
    ``gradient`` is a grid whose cell (0, 0) is cell ``corner`` of the window, and ``cells`` are the rows and
    columns of the means in this grid.
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
    """Correlate the gradient fields of both maps at all rotations, which does not depend on height offset and
    tilt.

    For each rotation the heights of the template are averaged over the cells of the reference. Peaks are
    refined by least squares of the heights, with estimated offset and tilt. The likelihood of a candidate
    follows from the fraction of the template's relief that the reference explains: places with similar slopes
    by chance rarely have the same heights.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the candidates, best first; raises RefusedError."""
        c, inputs = self.config, _with_coarse_reference(inputs)
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
        rotations = _rotations(float(reach_rad), min(geometry.resolution_m / radius_m, 0.5))
        templates = [
            _resample(points, centre, yaw + rotation, middle, window, _MIN_COVERED * per_cell)
            for rotation in rotations
        ]
        self._check_template(templates[len(templates) // 2])
        reach = max(1, ceil(float(reach_m) / window.resolution_m))
        volume = self._correlation_volume(templates, reference, reach)
        if not np.isfinite(volume).any():
            raise RefusedError(
                f"less than {c.min_overlap:.0%} of the template lies on the reference", ("outside",)
            )
        surface = HeightSurface.from_grid(heights)
        candidates: list[_Candidate] = []
        for rotation, row, col in _peaks(volume, c.candidates):
            shift = (row - reach, col - reach)
            candidate = self._refine(templates[rotation], shift, surface, reference, window, middle, centre)
            if candidate is not None:
                _add_candidate(candidates, candidate, centre, window.resolution_m)
        if not candidates:
            raise RefusedError("no gradient peak is confirmed by the heights", ("no_peak",))
        return self._outputs(sorted(candidates, key=lambda candidate: -candidate.explained), centre)

    def _check_template(self, template: _Template) -> None:
        """Raise RefusedError if the template has too few cells or too little relief."""
        c = self.config
        observed = np.isfinite(template.gradient[0])
        cells = int(np.count_nonzero(observed))
        if cells < _MIN_CELLS:
            raise RefusedError(
                f"{cells} cells of the template have a gradient, expected at least {_MIN_CELLS}",
                ("little_seen",),
            )
        relief = float(np.sqrt(sum(np.var(g[observed]) for g in template.gradient)))
        self.metrics = {"cells": cells, "relief": relief}
        if relief < c.min_relief:
            raise RefusedError(
                f"root mean square deviation of the slope {relief:.4f}, expected at least {c.min_relief}",
                ("flat",),
            )

    def _correlation_volume(
        self, templates: list[_Template], reference: tuple[FloatArray, FloatArray], reach: int
    ) -> FloatArray:
        """Return correlations ``(rotations, 2 reach + 1, 2 reach + 1)`` over rows and columns."""
        rows, cols = reference[0].shape
        largest = [max(t.gradient[0].shape[k] for t in templates) for k in (0, 1)]
        shape = (
            fft.next_fast_len(rows + largest[0], real=True),
            fft.next_fast_len(cols + largest[1], real=True),
        )
        reference_field = transform_field(reference, shape)
        shifts = np.arange(-reach, reach + 1)
        surfaces = []
        for t in templates:
            cells = int(np.count_nonzero(np.isfinite(t.gradient[0])))
            min_cells = max(self.config.min_overlap * cells, float(min(_MIN_CELLS, cells)))
            surface = correlation(transform_field(t.gradient, shape), reference_field, shape, min_cells)
            surfaces.append(
                surface[np.ix_((shifts + t.corner[0]) % shape[0], (shifts + t.corner[1]) % shape[1])]
            )
        return np.stack(surfaces)

    def _refine(
        self,
        template: _Template,
        shift: tuple[int, int],
        surface: HeightSurface,
        reference: tuple[FloatArray, FloatArray],
        window: GridGeometry,
        middle: FloatArray,
        centre: FloatArray,
    ) -> _Candidate | None:
        """Return the candidate of a peak after refinement; None if the heights do not confirm the peak."""
        config, c = self.config, window.resolution_m
        middle_cell = (
            (window.ymax_m - middle[1]) / c - 0.5 + shift[0],
            (middle[0] - window.xmin_m) / c - 0.5 + shift[1],
        )
        placement = refine_placement(
            surface, template.row + shift[0], template.col + shift[1], template.z_m, middle_cell
        )
        if placement is None or np.hypot(placement.row, placement.col) > _MAX_REFINEMENT_CELLS:
            return None
        value = _correlation_at(template, shift, placement, middle_cell, reference)
        x = window.xmin_m + (middle_cell[1] + placement.col + 0.5) * c
        y = window.ymax_m - (middle_cell[0] + placement.row + 0.5) * c
        R = se3.exp_so3(np.array([0.0, 0.0, template.yaw_rad + placement.rotation_rad]))
        x, y = np.array([x, y]) - (R @ centre)[:2]
        pose = se3.transform(R, np.array([x, y, placement.height_m]))
        scale = np.array([c, -c, 1.0, 1.0])
        covariance = config.covariance_inflation * placement.covariance * np.outer(scale, scale)
        covariance += np.diag([(config.floor_cells * c) ** 2] * 2 + [0.0, 0.0])
        relief_m = placement.relief_m
        explained = 1.0 - (placement.residual_m / relief_m) ** 2 if relief_m > 0.0 else 0.0
        return _Candidate(pose, covariance, value, explained, placement.cells)

    def _outputs(self, candidates: list[_Candidate], centre: FloatArray) -> Outputs:
        """Return the outputs for candidates, best first."""
        explained = np.array([candidate.explained for candidate in candidates])
        # Profile likelihood of the heights given the reference, with unknown noise that is correlated over
        # some cells.
        samples = np.array([candidate.cells for candidate in candidates]) / _CELLS_PER_SAMPLE
        bounded = np.clip(explained, None, _MAX_EXPLAINED)
        self.metrics = {
            **self.metrics,
            "explained": float(explained[0]),
            "correlation": candidates[0].correlation,
        }
        return Outputs(
            transforms=np.stack([candidate.transform for candidate in candidates]),
            covariances=np.stack([candidate.covariance for candidate in candidates]),
            correlations=np.array([candidate.correlation for candidate in candidates]),
            explained=explained,
            log_likelihoods=-0.5 * samples.max() * np.log1p(-bounded),
            centre=centre,
        )


def _with_coarse_reference(inputs: Inputs) -> Inputs:
    """Return the inputs with a reference whose cells are at least as large as those of the template."""
    template, reference = inputs.template.geometry, inputs.reference.geometry
    if template.resolution_m <= reference.resolution_m * (1.0 + 1e-9):
        return inputs
    grid = GridGeometry.aligned(reference.frame, template.resolution_m, reference.bounds)
    mean, _ = area_means(inputs.reference.layer("mean"), reference.bounds, grid)
    stamps = {"t0_ns": inputs.reference.t0_ns, "t1_ns": inputs.reference.t1_ns}
    coarse = ElevationMap.from_layers(grid, {"mean": mean.astype(np.float32)}, **stamps)
    return replace(inputs, reference=coarse)


def _points(inputs: Inputs) -> tuple[FloatArray, FloatArray]:
    """Return the centres and heights of the template's observed cells ``(n, 3)``, and their mean ``(3,)``."""
    template = inputs.template.geometry
    z = inputs.template.layer("mean").astype(np.float64)
    observed = np.isfinite(z)
    if not observed.any():
        raise RefusedError("the template has no observed cell", ("little_seen",))
    x, y = template.centres_m()
    points = np.column_stack([x[observed], y[observed], z[observed]])
    return points, points.mean(axis=0)


def _window(inputs: Inputs, middle: FloatArray, reach_m: float) -> tuple[GridGeometry, FloatArray]:
    """Return the part of the reference within reach of the middle, with its heights."""
    geometry = inputs.reference.geometry
    bounds = (middle[0] - reach_m, middle[1] - reach_m, middle[0] + reach_m, middle[1] + reach_m)
    search_area = GridGeometry.aligned(geometry.frame, geometry.resolution_m, bounds)
    window = geometry.intersection(search_area)
    if window is None or min(window.shape) < 3:
        raise RefusedError(f"no cell of the reference lies within {reach_m:.0f} m of the guess", ("outside",))
    heights = inputs.reference.layer("mean")[geometry.slices_of(window)].astype(np.float64)
    heights[~np.isfinite(heights)] = np.nan
    if np.isnan(heights).all():
        raise RefusedError(
            f"no cell of the reference within {reach_m:.0f} m of the guess is observed", ("outside",)
        )
    return window, heights


def _rotations(reach_rad: float, step_rad: float) -> FloatArray:
    """Return the rotations to test, symmetric about 0, at most a step apart."""
    count = ceil(reach_rad / step_rad)
    return np.linspace(-reach_rad, reach_rad, 2 * count + 1) if count else np.zeros(1)


def _resample(
    points: FloatArray,
    centre: FloatArray,
    yaw: float,
    middle: FloatArray,
    window: GridGeometry,
    min_points: float,
) -> _Template:
    """Return the template rotated by ``yaw``: mean position and height in each cell of the window, and
    gradient.
    """
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
    filled = np.flatnonzero(n >= max(min_points, 1.0))
    mean_row, mean_col, z_m = (
        np.bincount(index, v, len(n))[filled] / n[filled] for v in (row, col, points[:, 2])
    )
    heights = np.full(len(n), np.nan)
    heights[filled] = z_m
    cells = (filled // shape[1], filled % shape[1])
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
    """Return both components of the gradient, NaN where either is undefined."""
    x, y = horn_gradient(heights, cell_m)
    hole = np.isnan(x + y)
    return np.where(hole, np.nan, x), np.where(hole, np.nan, y)


def _peaks(volume: FloatArray, count: int) -> list[tuple[int, int, int]]:
    """Return rotation, row and column of the highest correlations that are not adjacent, best first."""
    finite_volume = np.nan_to_num(volume, nan=-2.0)
    highest, rotation = finite_volume.max(axis=0), finite_volume.argmax(axis=0)
    rows, cols = np.indices(highest.shape)
    peaks = []
    for _ in range(count):
        row, col = np.unravel_index(int(highest.argmax()), highest.shape)
        if highest[row, col] <= 0.0:
            break
        peaks.append((int(rotation[row, col]), int(row), int(col)))
        highest[np.hypot(rows - row, cols - col) <= _MIN_DISTANCE_CELLS] = -2.0
    return peaks


def _correlation_at(
    template: _Template,
    shift: tuple[int, int],
    placement: Placement,
    middle: tuple[float, float],
    reference: tuple[FloatArray, FloatArray],
) -> float:
    """Return the correlation of the gradients at the refined position; 0 without overlap."""
    gx, gy = (g[template.cells] for g in template.gradient)
    y, x = template.row + shift[0] - middle[0], template.col + shift[1] - middle[1]
    c, s = np.cos(placement.rotation_rad), np.sin(placement.rotation_rad)
    position = np.stack(
        [middle[0] + placement.row + c * y - s * x, middle[1] + placement.col + c * x + s * y]
    )
    # Interpolated values next to unobserved cells are NaN, as are positions outside (cval).
    hx, hy = (map_coordinates(g, position, order=1, cval=np.nan) for g in reference)
    usable = np.isfinite(gx) & np.isfinite(hx)
    if np.count_nonzero(usable) < 4:
        return 0.0
    a = np.stack([c * gx - s * gy, s * gx + c * gy])[:, usable]
    b = np.stack([hx, hy])[:, usable]
    a, b = (v - v.mean(axis=1, keepdims=True) for v in (a, b))
    norm = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum() / norm) if norm > 0.0 else 0.0


def _add_candidate(
    candidates: list[_Candidate], candidate: _Candidate, centre: FloatArray, cell_m: float
) -> None:
    """Add a candidate; of two at almost the same position, only the one that explains more is retained."""
    position = candidate.transform[:3, :3] @ centre + candidate.transform[:3, 3]
    for index, other in enumerate(candidates):
        difference = position - (other.transform[:3, :3] @ centre + other.transform[:3, 3])
        if np.hypot(difference[0], difference[1]) <= _MIN_DISTANCE_CELLS * cell_m:
            if candidate.explained > other.explained:
                candidates[index] = candidate
            return
    candidates.append(candidate)
