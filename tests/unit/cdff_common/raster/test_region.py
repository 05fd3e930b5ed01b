# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions on grids: contained cells and coverage."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry.region import parse_region
from cdff_common.raster import GridGeometry, coverage, mask


def test_a_circle_contains_the_cells_with_centres_inside() -> None:
    g = GridGeometry.aligned("site", 0.1, (-2, -2, 2, 2))
    inside = mask(parse_region("circle:0,0,1"), g)
    assert np.count_nonzero(inside) * 0.01 == pytest.approx(np.pi, rel=0.01)


def test_coverage_is_the_fraction_of_observed_cells_of_the_region() -> None:
    geometry = GridGeometry.aligned("site", 0.1, (0, 0, 2, 1))
    observed = np.zeros(geometry.shape, dtype=bool)
    observed[:, :10] = True
    assert coverage(parse_region("bbox:0,0,2,1"), geometry, observed) == pytest.approx(0.5)
    assert coverage(parse_region("bbox:0,0,1,1"), geometry, observed) == pytest.approx(1.0)
    assert coverage(parse_region("bbox:0,0,4,2"), geometry, observed) == pytest.approx(1.0 / 8.0)
    assert coverage(parse_region("bbox:10,10,12,12"), geometry, observed) == 0.0
