# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layers beyond the six: what they are of, and how they come together in a window of many maps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import ELEVATION_LAYERS, CellStatistics, GridGeometry
from cdff_common.raster.choice import Choice, Disagreement
from cdff_common.raster.further_layers import FurtherLayers
from cdff_common.raster.mosaic import Mosaic

S = 1_000_000_000
WINDOW = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.0, 1.0))


def cells(
    height_m: float, count: int, *, geometry: GridGeometry = WINDOW, pose: float | None = None, spread: float = 1e-4,
    intensity: float | None = None, first_age_s: float | None = None, overhang_m: float | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Layers of a flat map; a further layer that is not given is not there."""
    known = {
        "mean": height_m, "variance": spread + (pose or 0.0), "min": height_m - 0.01, "max": height_m + 0.01,
        "count": count, "age_s": 0.0,
        "pose_variance": pose, "intensity": intensity, "first_age_s": first_age_s, "overhang_m": overhang_m,
    }  # fmt: skip
    return {n: np.full(geometry.shape, v, np.float32) for n, v in known.items() if v is not None}


def pooled(*maps: tuple[int, dict[str, np.ndarray]], **rules: Any) -> dict[str, np.ndarray]:
    mosaic = Mosaic(WINDOW, **rules, further=True)
    for t_s, layers in maps:
        mosaic.add(WINDOW, layers, t_s * S)
    return mosaic.assembled().to_layers(max(t for t, _ in maps) * S)


FIRST = cells(0.0, 10, pose=0.01, intensity=20.0, first_age_s=2.0, overhang_m=1.5)
SECOND = cells(0.0, 30, pose=0.03, intensity=60.0, first_age_s=1.0, overhang_m=1.2)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_further_layers_pool_as_all_measurements_at_once_would(order: tuple[int, int]) -> None:
    maps = [(5, FIRST), (9, SECOND)]
    made = pooled(*(maps[k] for k in order))
    assert tuple(made)[:6] == ELEVATION_LAYERS
    expected = {
        "pose_variance": (10 * 0.01 + 30 * 0.03) / 40, "intensity": (10 * 20.0 + 30 * 60.0) / 40, "first_age_s": 6.0,
        "overhang_m": 1.2, "error_variance": 0.025 + 1e-4 / 40,
    }  # fmt: skip
    assert set(made) == {*ELEVATION_LAYERS, *expected}
    for name, value in expected.items():
        np.testing.assert_allclose(made[name], value, rtol=1e-5, err_msg=name)


def test_an_overhang_below_the_ground_that_contradicting_maps_leave_is_none() -> None:
    high = cells(5.0, 10, pose=0.01, first_age_s=0.0)
    made = pooled((5, FIRST), (9, high), disagreement=Disagreement("keep"))
    np.testing.assert_allclose(made["mean"], 2.5)
    assert "overhang_m" not in made


def test_maps_of_the_six_layers_make_a_window_of_the_six() -> None:
    assert tuple(pooled((1, cells(0.0, 10)), (2, cells(0.0, 5)))) == ELEVATION_LAYERS


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_one_of_the_maps_does_not_say_is_unknown_where_both_measured(order: tuple[int, int]) -> None:
    six = {name: layer.copy() for name, layer in cells(0.0, 10).items()}
    for layer in six.values():
        layer[:, 5:] = np.nan
    maps = [(5, six), (9, SECOND)]
    made = pooled(*(maps[k] for k in order))
    for name in ("pose_variance", "error_variance", "first_age_s"):
        assert np.isnan(made[name][:, :5]).all(), name
        assert np.isfinite(made[name][:, 5:]).all(), name
    np.testing.assert_allclose(made["intensity"], 60.0)
    np.testing.assert_allclose(made["overhang_m"], 1.2)


@pytest.mark.parametrize(
    ("rules", "chosen"),
    [
        ({"choice": Choice.NEWEST}, SECOND), ({"choice": Choice.OLDEST}, FIRST), ({"choice": Choice.BEST}, FIRST),
        ({"disagreement": Disagreement.NEWEST}, SECOND),
    ],
)  # fmt: skip
def test_a_cell_of_one_map_has_the_further_layers_of_that_map(rules: dict[str, Any], chosen: dict[str, Any]) -> None:
    lift = np.float32(2.0)  # they disagree by far
    high = SECOND | {name: SECOND[name] + lift for name in ("mean", "min", "max", "overhang_m")}
    made = pooled((5, FIRST), (9, high), **rules)
    expected = high if chosen is SECOND else FIRST
    for name in ("pose_variance", "intensity", "overhang_m"):
        np.testing.assert_allclose(made[name], expected[name], rtol=1e-6, err_msg=name)


def test_cells_dropped_for_disagreement_keep_nothing() -> None:
    high = SECOND | {name: SECOND[name] + np.float32(2.0) for name in ("mean", "min", "max")}
    assert tuple(pooled((5, FIRST), (9, high), disagreement=Disagreement.DROP)) == ELEVATION_LAYERS


def test_coarser_cells_hold_the_further_layers_of_all_in_them() -> None:
    fine = GridGeometry.aligned("site", 0.05, (0.0, 0.0, 1.0, 1.0))
    layers = cells(0.0, 2, geometry=fine, pose=0.01, intensity=10.0, first_age_s=1.0, overhang_m=3.0)
    layers["intensity"][:, ::2] = 30.0
    layers["overhang_m"][::2, ::2] = 1.0
    mosaic = Mosaic(WINDOW, further=True)
    mosaic.add(fine, layers, S)
    made = mosaic.assembled().to_layers(S)
    np.testing.assert_allclose(made["count"], 8)
    np.testing.assert_allclose(made["intensity"], 20.0)
    np.testing.assert_allclose(made["overhang_m"], 1.0)
    np.testing.assert_allclose(made["pose_variance"], 0.01, rtol=1e-6)


def test_a_map_of_another_frame_carries_its_overhangs_and_the_frames_doubt_is_common_to_all_heights() -> None:
    geometry = GridGeometry.aligned("mana/odom", 0.1, (-1.0, -1.0, 2.0, 2.0))
    layers = cells(0.0, 100, geometry=geometry, pose=0.01, intensity=7.0, first_age_s=1.0, overhang_m=1.5)
    covariance = np.zeros((6, 6))
    covariance[2, 2] = 0.04
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, 0.3]), [0.02, 0.03, 4.0]), covariance)
    mosaic = Mosaic(WINDOW, further=True)
    mosaic.add(geometry, layers, S, T)
    made = mosaic.assembled().to_layers(S)
    np.testing.assert_allclose(made["mean"], 4.0, atol=1e-6)
    np.testing.assert_allclose(made["overhang_m"], 5.5, atol=1e-6)
    np.testing.assert_allclose(made["intensity"], 7.0)
    np.testing.assert_allclose(made["pose_variance"], 0.05, rtol=1e-5)
    assert np.all(made["error_variance"] >= made["pose_variance"])


def test_a_layer_of_another_shape_is_refused() -> None:
    with pytest.raises(InputError, match="layer intensity: shape"):
        pooled((1, FIRST | {"intensity": FIRST["intensity"][1:]}))


def test_the_relief_is_that_of_the_neighbours_and_a_cell_alone_takes_the_usual_one(rng: np.random.Generator) -> None:
    geometry = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 1.2, 0.9))
    seen = rng.random(geometry.shape) < 0.5
    seen[:3, :3] = False
    seen[1, 1] = True
    mean = np.where(seen, rng.normal(0.0, 0.1, geometry.shape), 0.0)
    count = np.where(seen, 4.0, 0.0)
    statistics = CellStatistics(
        geometry, count, mean, count * 0.02, mean - 0.1, mean + 0.1, np.zeros(geometry.shape, np.int64)
    )
    further = FurtherLayers.empty(geometry)
    further.pose_m2 = count * 0.005
    made = further.to_layers(statistics, 0)["error_variance"]
    squares = np.full(geometry.shape, np.nan)
    padded, there = np.pad(mean, 1), np.pad(seen, 1)
    for r, c in zip(*np.nonzero(seen), strict=True):
        beside = [(r + i, c + j) for i, j in ((0, 1), (2, 1), (1, 0), (1, 2)) if there[r + i, c + j]]
        if beside:
            squares[r, c] = np.mean([(mean[r, c] - padded[k]) ** 2 for k in beside])
    assert np.isnan(squares[1, 1])
    relief = np.where(np.isnan(squares), np.nanmedian(squares), squares) / 6.0
    expected = np.where(seen, 0.005 + (0.015 + relief) / 4.0, np.nan)
    np.testing.assert_allclose(made, expected, rtol=1e-5)
