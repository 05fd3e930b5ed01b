# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import CellStatistics, GridGeometry

T_NS = 1_700_000_000_000_000_000
FIELDS = ("count", "mean", "m2", "minimum", "maximum", "newest_ns")


def cloud(rng: np.random.Generator, n: int = 4000, datum_m: float = 0.0) -> np.ndarray:
    return np.column_stack([rng.uniform(-2, 2, (n, 2)), datum_m + rng.normal(0.0, 0.3, n)])


def grid() -> GridGeometry:
    return GridGeometry.aligned("site", 0.25, (-2, -2, 2, 2))


def assert_same(a: CellStatistics, b: CellStatistics, rtol: float = 1e-12) -> None:
    assert a.geometry == b.geometry
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=rtol, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("datum_m", [0.0, -2500.0, 21_000.0])
def test_cell_statistics_agree_with_numpy(rng: np.random.Generator, datum_m: float) -> None:
    points, g = cloud(rng, datum_m=datum_m), grid()
    statistics = CellStatistics.from_points(g, points, stamps_ns=T_NS)
    rows, cols, inside = g.cells_of(points[:, 0], points[:, 1])
    for cell in [(0, 0), (3, 7), (15, 15)]:
        z = points[inside & (rows == cell[0]) & (cols == cell[1]), 2]
        assert statistics.count[cell] == len(z)
        assert statistics.mean[cell] == pytest.approx(z.mean(), rel=1e-14)
        assert statistics.variance[cell] == pytest.approx(z.var(), rel=1e-9)
        assert (statistics.minimum[cell], statistics.maximum[cell]) == (z.min(), z.max())


def test_cells_without_points_are_nan_in_every_layer(rng: np.random.Generator) -> None:
    points = cloud(rng)
    points = points[points[:, 0] < 0]
    layers = CellStatistics.from_points(grid(), points, stamps_ns=T_NS).to_layers(T_NS)
    for name, layer in layers.items():
        assert np.isnan(layer[:, 8:]).all(), name
        assert np.isfinite(layer[:, :8]).all(), name


def test_fusing_parts_gives_the_statistics_of_all_points_at_once(rng: np.random.Generator) -> None:
    points, stamps = cloud(rng), T_NS + 1000 * rng.integers(0, 10**6, 4000)
    variances = rng.uniform(0, 0.01, 4000)
    all_at_once = CellStatistics.from_points(grid(), points, stamps_ns=stamps, height_variance_m2=variances)
    fused = CellStatistics.empty(grid())
    for rows in np.array_split(rng.permutation(4000), 7):
        fused.add(
            CellStatistics.from_points(
                grid(), points[rows], stamps_ns=stamps[rows], height_variance_m2=variances[rows]
            )
        )
    assert_same(fused, all_at_once)


def fuse(first: CellStatistics, second: CellStatistics) -> CellStatistics:
    result = first.window(first.geometry.union(second.geometry))
    result.add(second)
    return result


def test_fusion_does_not_depend_on_order_or_window(rng: np.random.Generator) -> None:
    left = CellStatistics.from_points(
        GridGeometry.aligned("site", 0.25, (-2, -2, 0.5, 2)), cloud(rng), stamps_ns=T_NS
    )
    right = CellStatistics.from_points(
        GridGeometry.aligned("site", 0.25, (-0.5, -1, 2, 2)), cloud(rng), stamps_ns=T_NS + 1000
    )
    assert_same(fuse(left, right), fuse(right, left))
    assert fuse(left, right).count.sum() == left.count.sum() + right.count.sum()


def test_two_scans_that_disagree_are_less_certain_than_either(rng: np.random.Generator) -> None:
    z = rng.normal(0.0, 0.02, 500)
    xy = np.full((500, 2), 0.1)
    scans = [
        CellStatistics.from_points(grid(), np.column_stack([xy, z + dz]), stamps_ns=T_NS) for dz in (0.0, 0.3)
    ]
    sigma = np.sqrt(np.nanmax(fuse(*scans).variance))
    assert sigma == pytest.approx(np.hypot(0.15, 0.02), rel=0.02)


def test_the_mean_variance_of_the_points_is_added_to_their_scatter() -> None:
    points = np.array([[0.1, 0.1, 1.0], [0.1, 0.1, 3.0]])
    s = CellStatistics.from_points(grid(), points, stamps_ns=T_NS, height_variance_m2=[0.5, 1.5])
    assert np.nanmax(s.variance) == pytest.approx(1.0 + 1.0)


def test_statistics_survive_conversion_to_float32_layers(rng: np.random.Generator) -> None:
    statistics = CellStatistics.from_points(
        grid(), cloud(rng)[:200], stamps_ns=T_NS - 1_000_000 * rng.integers(0, 5000, 200)
    )
    reread = CellStatistics.from_layers(statistics.geometry, statistics.to_layers(T_NS), T_NS)
    np.testing.assert_array_equal(reread.observed, statistics.observed)
    np.testing.assert_allclose(reread.mean, statistics.mean, atol=1e-6)
    np.testing.assert_allclose(reread.m2, statistics.m2, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(
        reread.newest_ns[statistics.observed],
        statistics.newest_ns[statistics.observed],
        atol=1_000_000,
        rtol=0,
    )


def test_points_outside_the_window_or_not_finite_are_ignored() -> None:
    points = [[9, 0, 0], [0, np.nan, 0], [0, 0, np.inf], [0.1, 0.1, 1.0]]
    assert CellStatistics.from_points(grid(), points, stamps_ns=T_NS).count.sum() == 1


def test_no_points_give_an_empty_grid() -> None:
    assert not CellStatistics.from_points(grid(), np.empty((0, 3)), stamps_ns=T_NS).observed.any()


def test_a_mask_removes_exactly_its_measurements(rng: np.random.Generator) -> None:
    s = CellStatistics.from_points(grid(), cloud(rng), stamps_ns=T_NS)
    keep = np.zeros(grid().shape, dtype=bool)
    keep[4:6, 4:9] = True
    masked = s.masked(keep)
    assert masked.count.sum() == s.count[keep].sum()
    assert not masked.observed[~keep].any()


@pytest.mark.parametrize(
    "arguments",
    [
        {"points_m": np.zeros((4, 2)), "stamps_ns": T_NS},
        {"points_m": np.zeros((4, 3)), "stamps_ns": [T_NS, T_NS]},
        {"points_m": np.zeros((4, 3)), "stamps_ns": T_NS, "height_variance_m2": [1.0]},
        {"points_m": np.zeros((1, 3)), "stamps_ns": T_NS, "height_variance_m2": [-1.0]},
    ],
)
def test_arrays_of_inconsistent_shape_are_refused(arguments: dict[str, object]) -> None:
    with pytest.raises(InputError):
        CellStatistics.from_points(grid(), **arguments)  # type: ignore[arg-type]


def test_a_map_without_a_layer_or_of_another_shape_is_refused() -> None:
    layers = CellStatistics.empty(grid()).to_layers(T_NS)
    with pytest.raises(InputError, match="variance"):
        CellStatistics.from_layers(grid(), {k: v for k, v in layers.items() if k != "variance"}, T_NS)
    with pytest.raises(InputError, match="shape"):
        CellStatistics.from_layers(grid(), {**layers, "mean": np.zeros((2, 2))}, T_NS)


def test_heights_that_float32_rounds_by_more_than_a_tenth_of_a_cell_are_refused(
    rng: np.random.Generator,
) -> None:
    layers = CellStatistics.from_points(grid(), cloud(rng, datum_m=1e5), stamps_ns=T_NS).to_layers(T_NS)
    far = CellStatistics.from_points(grid(), cloud(rng, datum_m=1e6), stamps_ns=T_NS)
    with pytest.raises(InputError, match=r"height 1e\+06 m: float32 has steps of 0.062 m"):
        far.to_layers(T_NS)
    layers["mean"] = layers["mean"] + np.float32(1e9)
    with pytest.raises(InputError, match="use a datum near the terrain"):
        CellStatistics.from_layers(grid(), layers, T_NS)
