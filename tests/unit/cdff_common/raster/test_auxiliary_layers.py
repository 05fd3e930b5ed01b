# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Auxiliary layers and their fusion in a window of several maps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import ELEVATION_LAYERS, CellStatistics, GridGeometry
from cdff_common.raster.auxiliary_layers import COUNT_SQUARES, FIRST_US, POSE_VARIANCE_SUM, AuxiliaryLayers
from cdff_common.raster.cell_selection import Choice, Disagreement
from cdff_common.raster.mosaic import Mosaic
from cdff_common.raster.resample import aggregate
from cdff_common.types import ElevationMap

S = 1_000_000_000
WINDOW = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0))


def cells(
    height_m: float,
    count: int,
    *,
    geometry: GridGeometry = WINDOW,
    pose: float | None = None,
    spread: float = 1e-4,
    intensity: float | None = None,
    first_age_s: float | None = None,
    overhang_m: float | None = None,
) -> dict[str, np.ndarray]:
    """Return the layers of a flat map, with the given auxiliary layers only."""
    values = {
        "mean": height_m,
        "variance": spread + (pose or 0.0),
        "min": height_m - 0.01,
        "max": height_m + 0.01,
        "count": count,
        "age_s": 0.0,
        "pose_variance": pose,
        "intensity": intensity,
        "first_age_s": first_age_s,
        "overhang_m": overhang_m,
    }
    return {n: np.full(geometry.shape, v, np.float32) for n, v in values.items() if v is not None}


def fuse(*maps: tuple[int, dict[str, np.ndarray]], **rules: Any) -> dict[str, np.ndarray]:
    mosaic = Mosaic(WINDOW, **rules, auxiliary=True)
    for t_s, layers in maps:
        mosaic.add(WINDOW, layers, t_s * S)
    return mosaic.assembled().to_layers(max(t for t, _ in maps) * S)


FIRST = cells(0.0, 10, pose=0.01, intensity=20.0, first_age_s=2.0, overhang_m=1.5)
SECOND = cells(0.0, 30, pose=0.03, intensity=60.0, first_age_s=1.0, overhang_m=1.2)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_fused_auxiliary_layers_are_those_of_all_measurements_together(order: tuple[int, int]) -> None:
    maps = [(5, FIRST), (9, SECOND)]
    result = fuse(*(maps[k] for k in order))
    assert tuple(result)[:6] == ELEVATION_LAYERS
    expected = {
        "pose_variance": (10 * 0.01 + 30 * 0.03) / 40,
        "intensity": (10 * 20.0 + 30 * 60.0) / 40,
        "first_age_s": 6.0,
        "overhang_m": 1.2,
        "error_variance": 0.025 + 1e-4 / 40,
    }
    assert set(result) == {*ELEVATION_LAYERS, *expected}
    for name, value in expected.items():
        np.testing.assert_allclose(result[name], value, rtol=1e-5, err_msg=name)


def test_an_overhang_below_the_fused_ground_is_removed() -> None:
    high = cells(5.0, 10, pose=0.01, first_age_s=0.0)
    result = fuse((5, FIRST), (9, high), disagreement=Disagreement("keep"))
    np.testing.assert_allclose(result["mean"], 2.5)
    assert "overhang_m" not in result


def test_maps_without_auxiliary_layers_give_a_window_without_them() -> None:
    assert tuple(fuse((1, cells(0.0, 10)), (2, cells(0.0, 5)))) == ELEVATION_LAYERS


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_an_auxiliary_layer_missing_in_one_map_is_unknown_where_both_measured(order: tuple[int, int]) -> None:
    without_auxiliary = {name: layer.copy() for name, layer in cells(0.0, 10).items()}
    for layer in without_auxiliary.values():
        layer[:, 5:] = np.nan
    maps = [(5, without_auxiliary), (9, SECOND)]
    result = fuse(*(maps[k] for k in order))
    for name in ("pose_variance", "error_variance", "first_age_s"):
        assert np.isnan(result[name][:, :5]).all(), name
        assert np.isfinite(result[name][:, 5:]).all(), name
    np.testing.assert_allclose(result["intensity"], 60.0)
    np.testing.assert_allclose(result["overhang_m"], 1.2)


@pytest.mark.parametrize(
    ("rules", "expected_map"),
    [
        ({"choice": Choice.NEWEST}, SECOND),
        ({"choice": Choice.OLDEST}, FIRST),
        ({"choice": Choice.BEST}, FIRST),
        ({"disagreement": Disagreement.NEWEST}, SECOND),
    ],
)
def test_a_cell_of_one_map_has_the_auxiliary_layers_of_that_map(
    rules: dict[str, Any], expected_map: dict[str, Any]
) -> None:
    height_step_m = np.float32(2.0)  # far more than the standard deviations
    high = SECOND | {name: SECOND[name] + height_step_m for name in ("mean", "min", "max", "overhang_m")}
    result = fuse((5, FIRST), (9, high), **rules)
    expected = high if expected_map is SECOND else FIRST
    for name in ("pose_variance", "intensity", "overhang_m"):
        np.testing.assert_allclose(result[name], expected[name], rtol=1e-6, err_msg=name)


def test_cells_dropped_for_disagreement_have_no_auxiliary_layers() -> None:
    high = SECOND | {name: SECOND[name] + np.float32(2.0) for name in ("mean", "min", "max")}
    assert tuple(fuse((5, FIRST), (9, high), disagreement=Disagreement.DROP)) == ELEVATION_LAYERS


def test_coarser_cells_aggregate_the_auxiliary_layers() -> None:
    fine = GridGeometry.aligned("site", 0.05, (0.0, 0.0, 1.0, 1.0))
    layers = cells(0.0, 2, geometry=fine, pose=0.01, intensity=10.0, first_age_s=1.0, overhang_m=3.0)
    layers["intensity"][:, ::2] = 30.0
    layers["overhang_m"][::2, ::2] = 1.0
    mosaic = Mosaic(WINDOW, auxiliary=True)
    mosaic.add(fine, layers, S)
    window = mosaic.assembled().to_layers(S)
    np.testing.assert_allclose(window["count"], 8)
    np.testing.assert_allclose(window["intensity"], 20.0)
    np.testing.assert_allclose(window["overhang_m"], 1.0)
    np.testing.assert_allclose(window["pose_variance"], 0.01, rtol=1e-6)


def test_a_map_of_another_frame_is_transformed_with_overhangs_and_common_frame_error() -> None:
    geometry = GridGeometry.aligned("mana/odom", 0.1, (-1.0, -1.0, 2.0, 2.0))
    layers = cells(0.0, 100, geometry=geometry, pose=0.01, intensity=7.0, first_age_s=1.0, overhang_m=1.5)
    covariance = np.zeros((6, 6))
    covariance[2, 2] = 0.04
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, 0.3]), [0.02, 0.03, 4.0]), covariance)
    mosaic = Mosaic(WINDOW, auxiliary=True)
    mosaic.add(geometry, layers, S, T)
    window = mosaic.assembled().to_layers(S)
    np.testing.assert_allclose(window["mean"], 4.0, atol=1e-6)
    np.testing.assert_allclose(window["overhang_m"], 5.5, atol=1e-6)
    np.testing.assert_allclose(window["intensity"], 7.0)
    np.testing.assert_allclose(window["pose_variance"], 0.05, rtol=1e-5)
    assert np.all(window["error_variance"] >= window["pose_variance"])


def test_a_layer_of_another_shape_is_refused() -> None:
    with pytest.raises(InputError, match="layer intensity: shape"):
        fuse((1, FIRST | {"intensity": FIRST["intensity"][1:]}))


def test_the_relief_is_estimated_from_neighbours_or_a_default_for_isolated_cells(
    rng: np.random.Generator,
) -> None:
    geometry = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.2, 0.9))
    observed = rng.random(geometry.shape) < 0.5
    observed[:3, :3] = False
    observed[1, 1] = True
    mean = np.where(observed, rng.normal(0.0, 0.1, geometry.shape), 0.0)
    count = np.where(observed, 4.0, 0.0)
    statistics = CellStatistics(
        geometry, count, mean, count * 0.02, mean - 0.1, mean + 0.1, np.zeros(geometry.shape, np.int64)
    )
    auxiliary = AuxiliaryLayers.empty(geometry)
    auxiliary.sums[..., POSE_VARIANCE_SUM] = count * 0.005
    result = auxiliary.to_layers(statistics, 0)["error_variance"]
    squares = np.full(geometry.shape, np.nan)
    padded, padded_observed = np.pad(mean, 1), np.pad(observed, 1)
    for r, c in zip(*np.nonzero(observed), strict=True):
        neighbours = [
            (r + i, c + j) for i, j in ((0, 1), (2, 1), (1, 0), (1, 2)) if padded_observed[r + i, c + j]
        ]
        if neighbours:
            squares[r, c] = np.mean([(mean[r, c] - padded[k]) ** 2 for k in neighbours])
    assert np.isnan(squares[1, 1])
    relief = np.where(np.isnan(squares), np.nanmedian(squares), squares) / 6.0
    expected = np.where(observed, 0.005 + (0.015 + relief) / 4.0, np.nan)
    np.testing.assert_allclose(result, expected, rtol=1e-5)


def test_a_cell_without_a_finite_mean_has_no_heights() -> None:
    layers = FIRST | {"mean": FIRST["mean"].copy()}
    layers["mean"][0, :2] = np.nan, np.inf
    dem = ElevationMap.from_layers(WINDOW, layers, t0_ns=0, t1_ns=5 * S)
    auxiliary = AuxiliaryLayers.of_map(dem)
    np.testing.assert_array_equal(auxiliary.sums[0, :2, COUNT_SQUARES], 0.0)
    np.testing.assert_array_equal(auxiliary.sums[0, :2, FIRST_US], np.inf)
    np.testing.assert_array_equal(auxiliary.sums[0, 2:, COUNT_SQUARES], 100.0)
    statistics = CellStatistics.from_layers(WINDOW, layers, 5 * S)
    for factor in (1, 2, 10):
        coarse = aggregate(statistics, factor)
        stated = auxiliary.coarsened(factor).to_layers(coarse, 5 * S)["error_variance"]
        np.testing.assert_array_equal(np.isfinite(stated), coarse.count > 0)
