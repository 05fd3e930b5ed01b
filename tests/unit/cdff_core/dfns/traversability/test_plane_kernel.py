# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Planes of the compiled running sums are those of least squares in each square of cells."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.traversability._kernels import fit_planes

Array = np.ndarray


def plane(z: Array, r: int, c: int, half: int, min_cells: int) -> tuple[float, float, float, float]:
    """Return slope, RMS, height at the cell and leverage of the plane through the observed cells around it."""
    rows, cols = np.nonzero(np.isfinite(z))
    near = (np.abs(rows - r) <= half) & (np.abs(cols - c) <= half)
    A = np.column_stack([cols[near] - c, rows[near] - r, np.ones(near.sum())])
    moments = np.cov(A[:, :2].T, bias=True) if near.sum() > 1 else np.zeros((2, 2))
    if near.sum() < max(min_cells, 1) or np.linalg.det(moments) <= 0.05 * (0.5 * np.trace(moments)) ** 2:
        return np.nan, np.nan, np.nan, np.inf
    heights = z[rows[near], cols[near]]
    solution = np.linalg.lstsq(A, heights, rcond=None)[0]
    rms = np.sqrt(np.mean((heights - A @ solution) ** 2))
    return np.hypot(*solution[:2]), rms, solution[2], np.linalg.inv(A.T @ A)[2, 2]


@pytest.mark.parametrize(
    ("half", "min_cells", "unknown"), [(1, 3, 0.0), (1, 5, 0.4), (2, 6, 0.6), (3, 4, 0.85)]
)
def test_planes_are_those_of_least_squares(half: int, min_cells: int, unknown: float) -> None:
    rng = np.random.default_rng(3)
    z = rng.normal(0.0, 0.3, (9, 11)) + 0.2 * np.arange(11) - 0.1 * np.arange(9)[:, None]
    z[rng.random(z.shape) < unknown] = np.nan
    z[4, 4] = np.inf
    out = fit_planes(z, half, min_cells)
    expected = np.array([[plane(z, r, c, half, min_cells) for c in range(11)] for r in range(9)])
    for values, wanted, tolerance in zip(
        out, np.moveaxis(expected, 2, 0), (1e-9, 1e-7, 1e-9, 1e-9), strict=True
    ):
        np.testing.assert_allclose(values, wanted, rtol=1e-9, atol=tolerance)


def test_cells_along_a_line_and_too_few_cells_have_no_plane() -> None:
    line = np.full((5, 5), np.nan)
    line[2] = 1.0
    gradient, rms, middle, leverage = fit_planes(line, 2, 3)
    assert np.all(np.isnan(gradient))
    assert np.all(np.isnan(rms))
    assert np.all(np.isnan(middle))
    assert np.all(leverage == np.inf)
    corner = np.full((3, 3), np.nan)
    corner[0, 0], corner[0, 1], corner[1, 0] = 1.0, 2.0, 4.0
    for min_cells, is_fitted in ((3, True), (4, False)):
        gradient, rms, middle, leverage = fit_planes(corner, 1, min_cells)
        assert np.isfinite(middle[0, 0]) == is_fitted
    gradient, rms, middle, leverage = fit_planes(corner, 1, 3)
    assert gradient[0, 0] == pytest.approx(np.hypot(1.0, 3.0))
    assert rms[0, 0] == pytest.approx(0.0, abs=1e-7)
    assert middle[0, 0] == pytest.approx(1.0)
    assert leverage[0, 0] == pytest.approx(1.0)
    single = np.full((3, 3), np.nan)
    single[1, 1] = 1.0
    assert np.all(np.isnan(fit_planes(single, 1, 1)[2]))
    wide = np.full((13, 13), np.nan)
    wide[6] = 0.1 * np.arange(13)
    wide[5, 6] = 0.6
    assert plane(wide, 6, 6, 6, 3)[3] == np.inf  # the ratio of 0.02 is below the limit of 0.05
    assert np.isnan(fit_planes(wide, 6, 3)[2][6, 6])
    wide[4:9, 6] = 0.6
    np.testing.assert_allclose(fit_planes(wide, 6, 3)[2][6, 6], plane(wide, 6, 6, 6, 3)[2])
