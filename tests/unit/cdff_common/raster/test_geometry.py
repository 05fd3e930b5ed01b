# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry


def grid(xmin: float = 0.0, ymin: float = 0.0, xmax: float = 1.0, ymax: float = 2.0) -> GridGeometry:
    return GridGeometry.aligned("site", 0.05, (xmin, ymin, xmax, ymax))


def test_an_aligned_grid_is_the_smallest_that_covers_the_bounds() -> None:
    g = GridGeometry.aligned("site", 0.1, (-0.25, 0.31, 0.25, 0.5))
    assert (g.left, g.top, g.rows, g.cols) == (-3, 5, 2, 6)
    assert g.bounds == pytest.approx((-0.3, 0.3, 0.3, 0.5))


def test_rounding_at_cell_edges_adds_no_cells() -> None:
    g = GridGeometry.aligned("site", 0.1, (0.1 * 3, 0.0, 0.1 * 7, 0.1 * 3))
    assert g.shape == (3, 4)


def test_a_single_point_gets_one_cell() -> None:
    assert GridGeometry.aligned("site", 0.5, (0.2, 0.2, 0.2, 0.2)).shape == (1, 1)


def test_row_zero_is_at_ymax_and_centres_lie_in_their_cells() -> None:
    g = grid()
    x, y = g.centres_m()
    assert y[0, 0] == pytest.approx(1.975)
    rows, cols, inside = g.cells_of(x.ravel(), y.ravel())
    assert inside.all()
    np.testing.assert_array_equal(rows.reshape(g.shape), np.arange(g.rows)[:, None] * np.ones((1, g.cols)))
    np.testing.assert_array_equal(cols.reshape(g.shape), np.arange(g.cols)[None, :] * np.ones((g.rows, 1)))


def test_points_outside_the_grid_or_not_finite_are_marked() -> None:
    inside = grid().cells_of([-0.001, 0.0, 0.999, 1.0, np.nan, np.inf], [1.0, 0.0, 1.999, 1.0, 1.0, 1.0])[2]
    assert inside.tolist() == [False, True, True, False, False, False]


def test_two_windows_assign_a_point_to_the_same_cell_of_the_frame(rng: np.random.Generator) -> None:
    points = rng.uniform(-1, 1, (2000, 2))
    a = GridGeometry.aligned("site", 0.03, (-1, -1, 1, 1))
    b = GridGeometry.aligned("site", 0.03, (-7.3, -5.1, 4.4, 9.9))
    (ra, ca, _), (rb, cb, _) = a.cells_of(*points.T), b.cells_of(*points.T)
    np.testing.assert_array_equal(ca + a.left, cb + b.left)
    np.testing.assert_array_equal(a.top - ra, b.top - rb)


def test_union_intersection_and_slices_agree() -> None:
    a, b = grid(), grid(0.5, 1.0, 3.0, 4.0)
    union = a.union(b)
    assert union.bounds == pytest.approx((0.0, 0.0, 3.0, 4.0))
    intersection = a.intersection(b)
    assert intersection is not None
    assert intersection.bounds == pytest.approx((0.5, 1.0, 1.0, 2.0))
    rows, cols = union.slices_of(a)
    assert (rows.stop - rows.start, cols.stop - cols.start) == a.shape
    assert a.intersection(grid(5, 5, 6, 6)) is None


def test_grids_of_different_frames_or_cell_sizes_cannot_be_combined() -> None:
    with pytest.raises(InputError, match="the same frame and cell size"):
        grid().union(GridGeometry.aligned("mana/odom", 0.05, (0, 0, 1, 1)))
    with pytest.raises(InputError, match="aggregate"):
        grid().intersection(GridGeometry.aligned("site", 0.1, (0, 0, 1, 1)))


def test_a_window_beyond_the_grid_is_refused() -> None:
    with pytest.raises(InputError, match="extends beyond"):
        grid().slices_of(grid(0.5, 0.5, 1.5, 1.5))


def test_coarser_cells_are_aligned_and_cover_the_finer_ones() -> None:
    g = GridGeometry.from_cells("site", 0.05, left=-7, top=11, rows=5, cols=4).coarsened(4)
    assert (g.left, g.top, g.rows, g.cols) == (-2, 3, 2, 2)
    assert g.resolution_m == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"resolution_m": 0.0}, "above 0"),
        ({"resolution_m": float("nan")}, "above 0"),
        ({"rows": 0}, "at least 1"),
        ({"rows": 1 << 20, "cols": 1 << 20}, "at most"),
        ({"xmin_m": 0.013}, "multiple"),
        ({"frame": "Site"}, "frame"),
        ({"ymax_m": float("inf")}, "multiple"),
    ],
)
def test_a_wrong_value_is_refused_by_name(change: dict[str, object], message: str) -> None:
    valid: dict[str, object] = {
        "frame": "site",
        "resolution_m": 0.05,
        "xmin_m": 0.0,
        "ymax_m": 1.0,
        "rows": 2,
        "cols": 3,
    }
    with pytest.raises(InputError, match=message):
        GridGeometry(**{**valid, **change})  # type: ignore[arg-type]


@pytest.mark.parametrize("bounds", [(1, 0, 0, 1), (0, 0, float("nan"), 1), (0, 0, 1e9, 1e9)])
def test_reversed_infinite_or_huge_bounds_are_refused(bounds: tuple[float, float, float, float]) -> None:
    with pytest.raises(InputError):
        GridGeometry.aligned("site", 0.05, bounds)


def test_the_grid_around_points_is_the_smallest_that_contains_them(
    rng: np.random.Generator,
) -> None:
    points = np.vstack(
        [rng.uniform(-3, 4, (50, 3)), [[2.5, 4.5, 0.0]], [[np.nan, 9.0, 0.0]], [[9.0, 9.0, np.inf]]]
    )
    g = GridGeometry.around("site", 0.5, points)
    rows, cols, inside = g.cells_of(points[:51, 0], points[:51, 1])
    assert inside.all()
    assert (rows.min(), cols.min(), rows.max(), cols.max()) == (0, 0, g.rows - 1, g.cols - 1)


def test_points_without_finite_values_or_too_far_apart_have_no_grid() -> None:
    with pytest.raises(InputError, match="finite"):
        GridGeometry.around("site", 0.5, np.full((3, 3), np.nan))
    with pytest.raises(InputError, match="cells"):
        GridGeometry.around("site", 0.5, [[0.0, 0, 0], [1e3, 1e3, 0]], max_cells=1000)
    with pytest.raises(InputError, match="shape"):
        GridGeometry.around("site", 0.5, np.zeros((3, 2)))
