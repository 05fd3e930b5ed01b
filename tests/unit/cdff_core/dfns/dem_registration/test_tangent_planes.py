# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_registration.interface import DemRegistrationInputs, DemRegistrationOutputs
from cdff_core.dfns.dem_registration.tangent_planes import TangentPlanes

GRID = GridGeometry.aligned("site", 0.1, (-8.0, -8.0, 8.0, 8.0))
CENTRE = np.array([0.3, -0.2, 1.0])
PRIOR = np.diag([0.05, 0.05, 0.05, 0.02, 0.02, 0.02]) ** 2


def relief(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.3 * np.sin(x / 1.3) * np.cos(y / 1.1) + 0.1 * np.sin(0.7 * x + y)


def map_of_relief(rng: np.random.Generator, flat: bool = False) -> ElevationMap:
    xy = rng.uniform(-8, 8, (60_000, 2))
    z = 0 * xy[:, 0] if flat else relief(*xy.T)
    points = np.column_stack([xy, z + rng.normal(0, 0.01, len(xy))])
    layers = CellStatistics.from_points(GRID, points, stamps_ns=0).to_layers(0)
    return ElevationMap.from_layers(GRID, layers, t0_ns=0, t1_ns=0)


def fit(
    points: np.ndarray, dem: ElevationMap, prior: np.ndarray = PRIOR, **config: float
) -> DemRegistrationOutputs:
    node = TangentPlanes()
    node.configure(config)
    return node.process(
        DemRegistrationInputs(
            points=points, noise_variance=np.full(len(points), 1e-4), map=dem, centre=CENTRE, covariance=prior
        )
    )


def capture_points(rng: np.random.Generator, n: int = 5000, flat: bool = False) -> np.ndarray:
    xy = rng.uniform(-5, 5, (n, 2))
    return np.column_stack([xy, (0 * xy[:, 0] if flat else relief(*xy.T)) + rng.normal(0, 0.01, n)])


def test_a_wrong_pose_over_relief_is_corrected(rng: np.random.Generator) -> None:
    pose_error = se3.transform(se3.exp_so3([0.01, -0.008, 0.012]), [0.03, -0.04, 0.05])
    points = capture_points(rng)
    out = fit(se3.transform_points(pose_error, points), map_of_relief(rng))
    residual_m = se3.transform_points(out.correction @ pose_error, points) - points
    assert np.abs(residual_m[:, 2]).max() < 0.006
    assert np.linalg.norm(residual_m[:, :2], axis=1).max() < 0.02
    assert np.all(np.diag(out.covariance) < np.diag(PRIOR))


def test_flat_ground_leaves_position_and_heading_unchanged(rng: np.random.Generator) -> None:
    points = capture_points(rng, flat=True) + np.array([0.0, 0.0, 0.04])
    out = fit(points, map_of_relief(rng, flat=True))
    assert abs(out.correction[2, 3] + 0.04) < 0.003
    assert np.abs(out.correction[:2, 3]).max() < 0.03
    assert np.all(np.diag(out.covariance)[:2] > 20 * out.covariance[2, 2])


def test_moving_objects_do_not_shift_the_capture_points(rng: np.random.Generator) -> None:
    points = capture_points(rng)
    points[:600, 2] += 0.8
    assert abs(fit(points, map_of_relief(rng)).correction[2, 3]) < 0.005


def test_no_correction_outside_the_map_or_beyond_the_pose_covariance(
    rng: np.random.Generator,
) -> None:
    for points in (
        capture_points(rng) + np.array([100.0, 0.0, 0.0]),
        capture_points(rng) + np.array([0.0, 0.0, 2.0]),
    ):
        out = fit(points, map_of_relief(rng))
        assert out.matched == 0
        np.testing.assert_array_equal(out.correction, np.eye(4))
        np.testing.assert_array_equal(out.covariance, PRIOR)


@pytest.mark.parametrize(("count", "on_map"), [(199, 199), (200, 200), (2000, 399), (2000, 401)])
def test_few_points_or_a_small_part_of_them_on_the_map_give_no_correction(
    rng: np.random.Generator, count: int, on_map: int
) -> None:
    points = capture_points(rng, count) + np.array([0.0, 0.0, 0.03])
    points[on_map:, 0] += 100.0
    out = fit(points, map_of_relief(rng))
    assert out.matched == (on_map if on_map >= max(200, 0.2 * count) else 0)


def test_an_exact_pose_is_not_corrected(rng: np.random.Generator) -> None:
    out = fit(capture_points(rng) + np.array([0.0, 0.0, 0.0005]), map_of_relief(rng), np.zeros((6, 6)))
    np.testing.assert_allclose(out.correction, np.eye(4), atol=2e-4)


def test_an_invalid_covariance_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="semi-definite"):
        fit(capture_points(rng), map_of_relief(rng), -PRIOR)
