# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows of several maps: fused as exactly as from points, selected by cell, resampled without loss."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.raster.cell_selection import Choice, Disagreement
from cdff_common.raster.mosaic import Mosaic

S = 1_000_000_000
FIELDS = ("count", "mean", "m2", "minimum", "maximum")


def scan(
    rng: np.random.Generator,
    bounds: tuple[float, float, float, float],
    *,
    t_s: int = 1,
    cell_m: float = 0.1,
    height_m: float = 0.0,
    sd_m: float = 0.05,
    n: int = 4000,
    frame: str = "site",
) -> tuple[np.ndarray, GridGeometry, dict[str, np.ndarray]]:
    points = np.column_stack(
        [
            rng.uniform(bounds[0], bounds[2], n),
            rng.uniform(bounds[1], bounds[3], n),
            rng.normal(height_m, sd_m, n),
        ]
    )
    geometry = GridGeometry.aligned(frame, cell_m, bounds)
    cells = CellStatistics.from_points(geometry, points, stamps_ns=t_s * S)
    return points, geometry, cells.to_layers(t_s * S)


@pytest.mark.parametrize("cell_m", [0.1, 0.2, 0.5])
def test_a_fused_window_equals_the_statistics_of_all_points(rng: np.random.Generator, cell_m: float) -> None:
    window = GridGeometry.aligned("site", cell_m, (-1.0, -1.0, 3.0, 2.0))
    scans = [scan(rng, (i - 1.0, -0.5 * i, i + 2.0, 2.0), t_s=i + 1, height_m=0.1 * i) for i in range(3)]
    mosaic = Mosaic(window)
    for t_s, (_, geometry, layers) in enumerate(scans, start=1):
        assert mosaic.add(geometry, layers, t_s * S)
    fused = mosaic.assembled().statistics
    stamps = np.repeat(np.arange(1, 4) * S, [len(points) for points, _, _ in scans])
    direct = CellStatistics.from_points(
        window, np.vstack([points for points, _, _ in scans]), stamps_ns=stamps
    )
    for name in FIELDS:
        np.testing.assert_allclose(
            getattr(fused, name), getattr(direct, name), rtol=1e-5, atol=1e-6, err_msg=name
        )
    np.testing.assert_array_equal(fused.newest_ns, direct.newest_ns)
    assert mosaic.patches == 3


def test_the_variance_between_patches_is_included_and_disagreement_counted(rng: np.random.Generator) -> None:
    window = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0))
    mosaic = Mosaic(window)
    for t_s, height in ((1, 0.0), (2, 0.3)):
        _, geometry, layers = scan(rng, (0.0, 0.0, 1.0, 1.0), t_s=t_s, height_m=height, sd_m=0.01)
        mosaic.add(geometry, layers, t_s * S)
    assembled = mosaic.assembled()
    fused, disagreeing = assembled.statistics, assembled.disagreeing
    assert disagreeing == 100
    np.testing.assert_allclose(np.sqrt(fused.variance), 0.15, atol=0.01)


def window_of_disagreeing_patches(rule: Disagreement, rng: np.random.Generator) -> CellStatistics:
    window = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 2.0, 1.0))
    mosaic = Mosaic(window, disagreement=rule)
    for t_s, x1, height in ((2, 1.0, 0.3), (1, 2.0, 0.0)):  # newer patch first: the order has no effect
        _, geometry, layers = scan(rng, (0.0, 0.0, x1, 1.0), t_s=t_s, height_m=height, sd_m=0.01)
        mosaic.add(geometry, layers, t_s * S)
    assembled = mosaic.assembled()
    cells, count = assembled.statistics, assembled.disagreeing
    assert count == 100
    return cells


def test_disagreeing_cells_can_use_the_newest_patch(rng: np.random.Generator) -> None:
    cells = window_of_disagreeing_patches(Disagreement.NEWEST, rng)
    np.testing.assert_allclose(cells.mean[:, :10], 0.3, atol=0.02)
    np.testing.assert_allclose(cells.mean[:, 10:], 0.0, atol=0.02)
    assert np.sqrt(cells.variance).max() < 0.03


def test_disagreeing_cells_can_be_omitted(rng: np.random.Generator) -> None:
    cells = window_of_disagreeing_patches(Disagreement.DROP, rng)
    assert not cells.observed[:, :10].any()
    assert cells.observed[:, 10:].all()


@pytest.mark.parametrize("cell_m", [0.1, 0.2])
@pytest.mark.parametrize(
    ("choice", "height"), [(Choice.NEWEST, 3.0), (Choice.OLDEST, 1.0), (Choice.BEST, 2.0)]
)
def test_a_choice_uses_exactly_one_patch_for_each_cell(
    rng: np.random.Generator, choice: Choice, height: float, cell_m: float
) -> None:
    mosaic = Mosaic(GridGeometry.aligned("site", cell_m, (0.0, 0.0, 1.0, 1.0)), choice)
    counts = []
    for t_s, z, sd in ((1, 1.0, 0.2), (2, 2.0, 0.01), (3, 3.0, 0.3)):
        _, geometry, layers = scan(rng, (0.0, 0.0, 1.0, 1.0), t_s=t_s, height_m=z, sd_m=sd, n=8000)
        mosaic.add(geometry, layers, t_s * S)
        counts.append(float(np.nansum(layers["count"])))
    window = mosaic.assembled()
    cells, disagreeing = window.statistics, window.disagreeing
    np.testing.assert_allclose(cells.mean, height, atol=0.3)
    assert cells.count.sum() == counts[int(height) - 1]
    assert disagreeing == 0


def test_a_single_height_without_variance_is_not_preferred() -> None:
    window = GridGeometry.aligned("site", 1.0, (0.0, 0.0, 1.0, 1.0))
    mosaic = Mosaic(window, Choice.BEST)
    for points in ([[0.5, 0.5, 9.0]], [[0.5, 0.5, 1.0], [0.5, 0.5, 2.0]]):
        mosaic.add(window, CellStatistics.from_points(window, points, stamps_ns=S).to_layers(S), S)
    assert mosaic.assembled().statistics.mean[0, 0] == 1.5


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 45.0, 90.0, 133.0])
@pytest.mark.parametrize("cell_m", [0.1, 0.25])
def test_a_patch_of_another_frame_is_resampled_without_losses_or_holes(
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
    points_odom = T.inverse().apply(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 5.0)]))
    well_inside = np.all(np.abs(points_odom[:, :2]) < 1.0 - cell_m, axis=1).reshape(x.shape)
    assert cells.observed[well_inside].all()


def test_a_tilt_raises_distant_cells_and_adds_the_frame_covariance() -> None:
    window = GridGeometry.aligned("site", 0.5, (0.0, 0.0, 10.0, 1.0))
    flat = GridGeometry.aligned("tilted", 0.5, (0.0, 0.0, 10.0, 1.0))
    points = np.array([[x + 0.25, y + 0.25, 0.0] for x in np.arange(0, 10, 0.5) for y in (0.0, 0.5)])
    layers = CellStatistics.from_points(
        flat, points, stamps_ns=S, height_variance_m2=np.full(40, 1e-4)
    ).to_layers(S)
    covariance = np.diag(
        [0.0, 0.0, 0.01, 0.0, 1e-3, 0.0]
    )  # variances of the height and of the rotation about y
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, np.radians(-5.0), 0.0]), np.zeros(3)), covariance)
    mosaic = Mosaic(window)
    mosaic.add(flat, layers, S, T)
    cells = mosaic.assembled().statistics
    x = window.x_centres_m()
    near = cells.observed[0] & (x < 9.5)
    np.testing.assert_allclose(cells.mean[0, near], np.tan(np.radians(5.0)) * x[near], atol=0.05)
    np.testing.assert_allclose(
        cells.variance[0, near], 1e-4 + 0.01 + 1e-3 * x[near] ** 2, rtol=0.1, atol=0.002
    )


def test_cells_of_another_alignment_are_resampled_and_coarser_ones_refused(rng: np.random.Generator) -> None:
    _, geometry, layers = scan(rng, (0.0, 0.0, 3.0, 3.0), cell_m=0.1)
    mosaic = Mosaic(GridGeometry.aligned("site", 0.15, (0.0, 0.0, 3.0, 3.0)))
    mosaic.add(geometry, layers, S)
    assert mosaic.assembled().statistics.count.sum() == pytest.approx(4000)
    with pytest.raises(InputError, match="not resampled to finer"):
        Mosaic(GridGeometry.aligned("site", 0.05, (0.0, 0.0, 1.0, 1.0))).add(geometry, layers, S)


def test_maps_that_cannot_be_resampled_are_refused(rng: np.random.Generator) -> None:
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


def test_a_map_outside_the_window_has_no_effect(rng: np.random.Generator) -> None:
    _, geometry, layers = scan(rng, (5.0, 5.0, 6.0, 6.0))
    mosaic = Mosaic(GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0)))
    assert not mosaic.add(geometry, layers, S)
    assert not mosaic.assembled().statistics.observed.any()


def test_warming_compiles_every_raster_kernel() -> None:
    from cdff_common.raster import _auxiliary_kernels, _kernels
    from cdff_common.raster.warm import warm_rasters

    warm_rasters()
    for kernel in (
        _kernels.pool_layers,
        _kernels.pool_resampled,
        _kernels.pool_blocks,
        _kernels.fill_layers,
        _auxiliary_kernels.fill_auxiliary,
    ):
        assert kernel.signatures
