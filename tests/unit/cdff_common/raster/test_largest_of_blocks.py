# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``largest_of_blocks``: a coarse cell has the maximum of its fine cells, for any ratio."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.resample import largest_of_blocks


@pytest.mark.parametrize("factor", [1, 2, 3, 7, 100, 2**17])
@pytest.mark.parametrize(("left", "top"), [(0, 0), (-5, 3), (2, -4), (131_070, 17)])
def test_each_coarse_cell_has_the_maximum_of_its_cells(factor: int, left: int, top: int) -> None:
    rng = np.random.default_rng(factor)
    fine = GridGeometry.from_cells("site", 0.1, left=left, top=top, rows=11, cols=13)
    classes = rng.integers(0, 4, fine.shape).astype(np.uint8)
    slopes = np.where(classes == 0, np.nan, rng.random(fine.shape)).astype(np.float32)
    result, coarse = largest_of_blocks({"class": classes, "slope_deg": slopes}, fine, factor)
    assert coarse == fine.coarsened(factor)
    assert result["class"].dtype == np.uint8
    assert result["slope_deg"].dtype == np.float32
    row, col, inside = coarse.cells_of(*(axis.ravel() for axis in fine.centres_m()))
    assert inside.all()
    worst = np.zeros(coarse.shape, dtype=np.uint8)
    np.maximum.at(worst, (row, col), classes.ravel())
    steepest = np.full(coarse.shape, -np.inf, dtype=np.float32)
    np.maximum.at(steepest, (row, col), np.nan_to_num(slopes, nan=-np.inf).ravel())
    assert np.array_equal(result["class"], worst)
    assert np.array_equal(np.nan_to_num(result["slope_deg"], nan=-np.inf), steepest)
