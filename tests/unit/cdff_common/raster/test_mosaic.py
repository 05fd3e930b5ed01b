# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows out of many maps: exact against the points themselves, chosen cell by cell, resampled without loss."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.raster.choice import Choice, Disagreement
from cdff_common.raster.mosaic import Mosaic

S = 1_000_000_000
FIELDS = ("count", "mean", "m2", "minimum", "maximum")


def scan(
    rng: np.random.Generator, bounds: tuple[float, float, float, float], *, t_s: int = 1, cell_m: float = 0.1,
    height_m: float = 0.0, sd_m: float = 0.05, n: int = 4000, frame: str = "site",
) -> tuple[np.ndarray, GridGeometry, dict[str, np.ndarray]]:  # fmt: skip
    points = np.column_stack(
        [rng.uniform(bounds[0], bounds[2], n), rng.uniform(bounds[1], bounds[3], n), rng.normal(height_m, sd_m, n)]
    )
    geometry = GridGeometry.aligned(frame, cell_m, bounds)
    cells = CellStatistics.from_points(geometry, points, stamps_ns=t_s * S)
    return points, geometry, cells.to_layers(t_s * S)


@pytest.mark.parametrize("cell_m", [0.1, 0.2, 0.5])
def test_a_pooled_window_equals_the_statistics_of_all_points(rng: np.random.Generator, cell_m: float) -> None:
    window = GridGeometry.aligned("site", cell_m, (-1.0, -1.0, 3.0, 2.0))
    scans = [scan(rng, (i - 1.0, -0.5 * i, i + 2.0, 2.0), t_s=i + 1, height_m=0.1 * i) for i in range(3)]
    mosaic = Mosaic(window)
    for t_s, (_, geometry, layers) in enumerate(scans, start=1):
        assert mosaic.add(geometry, layers, t_s * S)
    pooled = mosaic.assembled().statistics
    stamps = np.repeat(np.arange(1, 4) * S, [len(points) for points, _, _ in scans])
    direct = CellStatistics.from_points(window, np.vstack([points for points, _, _ in scans]), stamps_ns=stamps)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(pooled, name), getattr(direct, name), rtol=1e-5, atol=1e-6, err_msg=name)
    np.testing.assert_array_equal(pooled.newest_ns, direct.newest_ns)
    assert mosaic.patches == 3


def test_the_spread_between_patches_stays_in_the_variance_and_is_counted(rng: np.random.Generator) -> None:
    window = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0))
    mosaic = Mosaic(window)
    for t_s, height in ((1, 0.0), (2, 0.3)):
        _, geometry, layers = scan(rng, (0.0, 0.0, 1.0, 1.0), t_s=t_s, height_m=height, sd_m=0.01)
        mosaic.add(geometry, layers, t_s * S)
    made = mosaic.assembled()
    pooled, disagreeing = made.statistics, made.disagreeing
    assert disagreeing == 100
    np.testing.assert_allclose(np.sqrt(pooled.variance), 0.15, atol=0.01)


def disagreeing(rule: Disagreement, rng: np.random.Generator) -> CellStatistics:
    window = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 2.0, 1.0))
    mosaic = Mosaic(window, disagreement=rule)
    for t_s, x1, height in ((2, 1.0, 0.3), (1, 2.0, 0.0)):  # the newer one first: order does not matter
        _, geometry, layers = scan(rng, (0.0, 0.0, x1, 1.0), t_s=t_s, height_m=height, sd_m=0.01)
        mosaic.add(geometry, layers, t_s * S)
    made = mosaic.assembled()
    cells, count = made.statistics, made.disagreeing
    assert count == 100
    return cells


def test_disagreeing_cells_can_hold_what_the_newest_patch_says(rng: np.random.Generator) -> None:
    cells = disagreeing(Disagreement.NEWEST, rng)
    np.testing.assert_allclose(cells.mean[:, :10], 0.3, atol=0.02)
    np.testing.assert_allclose(cells.mean[:, 10:], 0.0, atol=0.02)
    assert np.sqrt(cells.variance).max() < 0.03


def test_disagreeing_cells_can_be_left_out(rng: np.random.Generator) -> None:
    cells = disagreeing(Disagreement.DROP, rng)
    assert not cells.observed[:, :10].any()
    assert cells.observed[:, 10:].all()


@pytest.mark.parametrize("cell_m", [0.1, 0.2])
@pytest.mark.parametrize(("choice", "height"), [(Choice.NEWEST, 3.0), (Choice.OLDEST, 1.0), (Choice.BEST, 2.0)])
def test_a_choice_takes_each_cell_whole_from_one_patch(
    rng: np.random.Generator, choice: Choice, height: float, cell_m: float
) -> None:
    mosaic = Mosaic(GridGeometry.aligned("site", cell_m, (0.0, 0.0, 1.0, 1.0)), choice)
    counts = []
    for t_s, z, sd in ((1, 1.0, 0.2), (2, 2.0, 0.01), (3, 3.0, 0.3)):
        _, geometry, layers = scan(rng, (0.0, 0.0, 1.0, 1.0), t_s=t_s, height_m=z, sd_m=sd, n=8000)
        mosaic.add(geometry, layers, t_s * S)
        counts.append(float(np.nansum(layers["count"])))
    made = mosaic.assembled()
    cells, disagreeing = made.statistics, made.disagreeing
    np.testing.assert_allclose(cells.mean, height, atol=0.3)
    assert cells.count.sum() == counts[int(height) - 1]
    assert disagreeing == 0


def test_one_height_without_a_variance_is_not_the_best() -> None:
    window = GridGeometry.aligned("site", 1.0, (0.0, 0.0, 1.0, 1.0))
    mosaic = Mosaic(window, Choice.BEST)
    for points in ([[0.5, 0.5, 9.0]], [[0.5, 0.5, 1.0], [0.5, 0.5, 2.0]]):
        mosaic.add(window, CellStatistics.from_points(window, points, stamps_ns=S).to_layers(S), S)
    assert mosaic.assembled().statistics.mean[0, 0] == 1.5


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 45.0, 90.0, 133.0])
@pytest.mark.parametrize("cell_m", [0.1, 0.25])
def test_a_patch_of_another_frame_loses_no_height_and_leaves_no_hole(
    rng: np.random.Generator, yaw_deg: float, cell_m: float
) -> None:
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, np.radians(yaw_deg)]), [0.537, -0.283, 5.0]))
    _, geometry, layers = scan(rng, (-1.0, -1.0, 1.0, 1.0), frame="mana/odom", n=60_000)
    window = GridGeometry.aligned("site", cell_m, (-3.0, -3.0, 3.0, 3.0))
    mosaic = Mosaic(window)
    assert mosaic.add(geometry, layers, S, T)
    cells = mosaic.assembled().statistics
    assert cells.count.sum() == pytest.approx(60_000)
    np.testing.assert_allclose(cells.mean[cells.observed], 5.0, atol=0.06)
    x, y = window.centres_m()
    back = T.inverse().apply(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 5.0)]))
    deep = np.all(np.abs(back[:, :2]) < 1.0 - cell_m, axis=1).reshape(x.shape)
    assert cells.observed[deep].all()


def test_a_tilt_lifts_the_far_side_and_the_frames_covariance_widens_it() -> None:
    window = GridGeometry.aligned("site", 0.5, (0.0, 0.0, 10.0, 1.0))
    flat = GridGeometry.aligned("tilted", 0.5, (0.0, 0.0, 10.0, 1.0))
    points = np.array([[x + 0.25, y + 0.25, 0.0] for x in np.arange(0, 10, 0.5) for y in (0.0, 0.5)])
    layers = CellStatistics.from_points(flat, points, stamps_ns=S, height_variance_m2=np.full(40, 1e-4)).to_layers(S)
    covariance = np.diag([0.0, 0.0, 0.01, 0.0, 1e-3, 0.0])  # of the height, and of the turn about y
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, np.radians(-5.0), 0.0]), np.zeros(3)), covariance)
    mosaic = Mosaic(window)
    mosaic.add(flat, layers, S, T)
    cells = mosaic.assembled().statistics
    x = window.x_centres_m()
    near = cells.observed[0] & (x < 9.5)
    np.testing.assert_allclose(cells.mean[0, near], np.tan(np.radians(5.0)) * x[near], atol=0.05)
    np.testing.assert_allclose(cells.variance[0, near], 1e-4 + 0.01 + 1e-3 * x[near] ** 2, rtol=0.1, atol=0.002)


def test_cells_that_do_not_fit_are_resampled_and_coarser_ones_refused(rng: np.random.Generator) -> None:
    _, geometry, layers = scan(rng, (0.0, 0.0, 3.0, 3.0), cell_m=0.1)
    mosaic = Mosaic(GridGeometry.aligned("site", 0.15, (0.0, 0.0, 3.0, 3.0)))
    mosaic.add(geometry, layers, S)
    assert mosaic.assembled().statistics.count.sum() == pytest.approx(4000)
    with pytest.raises(InputError, match="never made finer"):
        Mosaic(GridGeometry.aligned("site", 0.05, (0.0, 0.0, 1.0, 1.0))).add(geometry, layers, S)


def test_what_cannot_be_resampled_is_refused(rng: np.random.Generator) -> None:
    _, geometry, layers = scan(rng, (0.0, 0.0, 1.0, 1.0), frame="mana/odom")
    mosaic = Mosaic(GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0)))
    with pytest.raises(InputError, match="expected a transform"):
        mosaic.add(geometry, layers, S)
    with pytest.raises(InputError, match="tilted"):
        mosaic.add(geometry, layers, S, UncertainTransform(se3.exp_se3([0, 0, 0, 1.0, 0, 0])))
    with pytest.raises(InputError, match="only pooled"):
        Mosaic(mosaic.geometry, Choice.NEWEST, Disagreement.DROP)
    with pytest.raises(InputError, match="without layer 'age_s'"):
        mosaic.add(geometry, {k: v for k, v in layers.items() if k != "age_s"}, S)
    with pytest.raises(InputError, match="shape"):
        mosaic.add(geometry, {k: v[1:] for k, v in layers.items()}, S)


def test_a_map_beside_the_window_leaves_it_as_it_was(rng: np.random.Generator) -> None:
    _, geometry, layers = scan(rng, (5.0, 5.0, 6.0, 6.0))
    mosaic = Mosaic(GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0)))
    assert not mosaic.add(geometry, layers, S)
    assert not mosaic.assembled().statistics.observed.any()


def test_the_loops_are_compiled_for_maps_as_they_come_from_the_wire() -> None:
    from cdff_common.raster import _further_kernels, _kernels
    from cdff_common.raster.warm import warm_rasters

    warm_rasters()
    for kernel in (
        _kernels.pool_layers, _kernels.pool_moved, _kernels.pool_blocks, _kernels.fill_layers,
        _further_kernels.pool_further, _further_kernels.pool_further_moved, _further_kernels.fill_further,
    ):  # fmt: skip
        assert kernel.signatures
