# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import (
    CellStatistics,
    GridGeometry,
    aggregate,
    delivered_resolution,
)

T_NS = 1_700_000_000_000_000_000


def patch(
    rng: np.random.Generator, resolution_m: float, bounds: tuple[float, float, float, float], n: int = 3000
):
    x = rng.uniform(bounds[0], bounds[2], n)
    y = rng.uniform(bounds[1], bounds[3], n)
    points = np.column_stack([x, y, 100.0 + rng.normal(0.0, 0.5, n)])
    g = GridGeometry.aligned("site", resolution_m, bounds)
    return points, CellStatistics.from_points(g, points, stamps_ns=T_NS + 1000 * rng.integers(0, 99, n))


def test_aggregated_cells_equal_the_statistics_of_their_points(rng: np.random.Generator) -> None:
    points, fine = patch(rng, 0.05, (-0.35, -0.15, 1.1, 0.85))
    coarse = aggregate(fine, 4)
    direct = CellStatistics.from_points(coarse.geometry, points, stamps_ns=T_NS)
    for name in ("count", "mean", "m2", "minimum", "maximum"):
        np.testing.assert_allclose(
            getattr(coarse, name), getattr(direct, name), rtol=1e-12, atol=1e-9, err_msg=name
        )
    assert coarse.newest_ns.max() == fine.newest_ns.max()


def test_a_coarse_cell_is_unobserved_only_where_all_its_cells_are() -> None:
    g = GridGeometry.aligned("site", 0.5, (0, 0, 2, 2))
    coarse = aggregate(CellStatistics.from_points(g, [[0.1, 1.9, 3.0]], stamps_ns=T_NS), 2)
    assert coarse.observed.tolist() == [[True, False], [False, False]]


@pytest.mark.parametrize(
    ("data_m", "requested_m", "expected_m"),
    [
        ([0.05], 0.05, 0.05),
        ([0.05], 0.12, 0.1),
        ([0.05], 0.01, 0.05),
        ([0.05, 0.2], 0.05, 0.2),
        ([0.1], None, 0.1),
        ([0.05], 0.15, 0.15),
    ],
)
def test_delivered_cells_are_never_finer_than_the_data_nor_coarser_than_requested(
    data_m: list[float], requested_m: float | None, expected_m: float
) -> None:
    assert delivered_resolution(data_m, requested_m) == pytest.approx(expected_m)


@pytest.mark.parametrize(
    ("data_m", "requested_m"), [([], 0.1), ([0.05], 0.0), ([0.05], float("nan")), ([0.03, 0.05], None)]
)
def test_cell_sizes_that_cannot_be_aggregated_are_refused(
    data_m: list[float], requested_m: float | None
) -> None:
    with pytest.raises(InputError):
        delivered_resolution(data_m, requested_m)


def test_aggregating_by_less_than_one_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="factor"):
        aggregate(patch(rng, 0.5, (0, 0, 2, 2))[1], 0)
