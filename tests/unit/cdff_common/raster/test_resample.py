# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import CellStatistics, GridGeometry, WindowAssembler, aggregate, assemble, delivered_resolution

T_NS = 1_700_000_000_000_000_000


def patch(rng: np.random.Generator, resolution_m: float, bounds: tuple[float, float, float, float], n: int = 3000):
    x = rng.uniform(bounds[0], bounds[2], n)
    y = rng.uniform(bounds[1], bounds[3], n)
    points = np.column_stack([x, y, 100.0 + rng.normal(0.0, 0.5, n)])
    g = GridGeometry.aligned("site", resolution_m, bounds)
    return points, CellStatistics.from_points(g, points, stamps_ns=T_NS + 1000 * rng.integers(0, 99, n))


def test_aggregated_cells_equal_the_statistics_of_their_points(rng: np.random.Generator) -> None:
    points, fine = patch(rng, 0.05, (-0.35, -0.15, 1.1, 0.85))
    coarse = aggregate(fine, 4)
    direct = CellStatistics.from_points(coarse.geometry, points, stamps_ns=fine.newest_stamp_ns or 0)
    for name in ("count", "mean", "m2", "minimum", "maximum"):
        np.testing.assert_allclose(getattr(coarse, name), getattr(direct, name), rtol=1e-12, atol=1e-9, err_msg=name)
    assert coarse.newest_stamp_ns == fine.newest_stamp_ns


def test_a_coarse_cell_is_unobserved_only_where_all_its_cells_are() -> None:
    g = GridGeometry.aligned("site", 0.5, (0, 0, 2, 2))
    coarse = aggregate(CellStatistics.from_points(g, [[0.1, 1.9, 3.0]], stamps_ns=T_NS), 2)
    assert coarse.observed.tolist() == [[True, False], [False, False]]


@pytest.mark.parametrize(
    ("known", "wanted", "delivered"),
    [
        ([0.05], 0.05, 0.05),
        ([0.05], 0.12, 0.1),
        ([0.05], 0.01, 0.05),
        ([0.05, 0.2], 0.05, 0.2),
        ([0.1], None, 0.1),
        ([0.05], 0.15, 0.15),
    ],
)
def test_delivered_cells_are_never_finer_than_the_data_nor_coarser_than_asked(
    known: list[float], wanted: float | None, delivered: float
) -> None:
    assert delivered_resolution(known, wanted) == pytest.approx(delivered)


@pytest.mark.parametrize(("known", "wanted"), [([], 0.1), ([0.05], 0.0), ([0.05], float("nan")), ([0.03, 0.05], None)])
def test_cell_sizes_that_cannot_be_pooled_are_refused(known: list[float], wanted: float | None) -> None:
    with pytest.raises(InputError):
        delivered_resolution(known, wanted)


def test_aggregating_by_less_than_one_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="factor"):
        aggregate(patch(rng, 0.5, (0, 0, 2, 2))[1], 0)


def test_a_window_over_patches_of_two_cell_sizes_counts_each_measurement_once(rng: np.random.Generator) -> None:
    points_a, a = patch(rng, 0.05, (-1.0, -1.0, 1.0, 1.0))
    points_b, b = patch(rng, 0.1, (0.0, -0.5, 2.0, 1.5))
    window = assemble([a, b], "site", (-0.5, -0.5, 1.5, 0.5), 0.25)
    assert window.geometry.resolution_m == pytest.approx(0.2)
    everything = np.vstack([points_a, points_b])
    direct = CellStatistics.from_points(window.geometry, everything, stamps_ns=T_NS)
    for name in ("count", "mean", "m2", "minimum", "maximum"):
        np.testing.assert_allclose(getattr(window, name), getattr(direct, name), rtol=1e-12, atol=1e-9, err_msg=name)


def test_the_order_of_the_patches_does_not_matter(rng: np.random.Generator) -> None:
    patches = [patch(rng, 0.1, (0, 0, 1 + i, 1))[1] for i in range(4)]
    one = assemble(patches, "site", (0, 0, 3, 1))
    two = assemble(patches[::-1], "site", (0, 0, 3, 1))
    np.testing.assert_allclose(one.m2, two.m2, rtol=1e-12)
    np.testing.assert_allclose(one.mean, two.mean, rtol=1e-14)


def test_a_patch_beside_the_window_leaves_it_as_it_was(rng: np.random.Generator) -> None:
    assembler = WindowAssembler(GridGeometry.aligned("site", 0.1, (10, 10, 11, 11)))
    assert not assembler.add(patch(rng, 0.1, (0, 0, 1, 1))[1])
    assert assembler.patches == 0
    assert not assembler.statistics.observed.any()


def test_a_patch_of_coarser_cells_than_the_window_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="do not fit"):
        WindowAssembler(GridGeometry.aligned("site", 0.05, (0, 0, 1, 1))).add(patch(rng, 0.1, (0, 0, 1, 1))[1])
