# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The covariance of a converted product agrees with Monte Carlo samples of the transform."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, PoseTrajectory, TransformWithCovariance
from cdff_core.orchestration import conversion

FloatArray = NDArray[np.float64]
DRAWS = 20_000
S = 1_000_000_000


def uncertain(
    rng: np.random.Generator, sigma_m: float = 0.02, sigma_rad: float = 0.005
) -> UncertainTransform:
    """Return a transform with correlated errors."""
    mix = rng.normal(size=(6, 6))
    scale = np.diag([sigma_m] * 3 + [sigma_rad] * 3)
    covariance = scale @ (mix @ mix.T / 6.0 + np.eye(6)) @ scale
    return UncertainTransform(se3.transform(se3.exp_so3(rng.normal(size=3)), rng.normal(0, 5, 3)), covariance)


def draws(T: UncertainTransform, rng: np.random.Generator) -> FloatArray:
    """Return ``(DRAWS, 4, 4)`` samples of a transform, with errors in the parent frame."""
    assert T.covariance is not None
    errors = rng.multivariate_normal(np.zeros(6), T.covariance, DRAWS)
    drawn_poses = np.tile(T.matrix, (DRAWS, 1, 1))
    drawn_poses[:, :3, :3] = np.stack([se3.exp_so3(e) for e in errors[:, 3:]]) @ T.matrix[:3, :3]
    drawn_poses[:, :3, 3] += errors[:, :3]
    return drawn_poses


def sample_covariance(drawn: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the covariance of samples around a transform, errors in the parent frame."""
    phi = np.stack([se3.log_so3(R @ mean[:3, :3].T) for R in drawn[:, :3, :3]])
    errors = np.column_stack([drawn[:, :3, 3] - mean[:3, 3], phi])
    return np.asarray(errors.T @ errors / len(errors))


def assert_close(P: FloatArray, drawn: FloatArray) -> None:
    """Compare a covariance with the sampled one: within 4 standard errors of each element plus 1 %."""
    sigma = np.sqrt(np.diag(drawn))
    scale = np.outer(sigma, sigma)
    limit = 4.0 * np.sqrt(2.0 / DRAWS) + 0.01
    np.testing.assert_array_less(np.abs(P - drawn) / scale, limit)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-021")
def test_a_composed_pose_includes_the_errors_of_both_edges(rng: np.random.Generator) -> None:
    T_frame_home, T_home_base = uncertain(rng), uncertain(rng)
    composed = T_frame_home @ T_home_base
    drawn = sample_covariance(draws(T_frame_home, rng) @ draws(T_home_base, rng), composed.matrix)
    value, reasons = conversion.pose_as(composed, "frame", "base", S, "TransformWithCovariance", "")
    assert isinstance(value, TransformWithCovariance)
    assert value.transform.covariance is not None
    assert not reasons
    assert_close(value.transform.covariance, drawn)
    state, reasons = conversion.pose_as(composed, "frame", "base", S, "RigidBodyState", "")
    position = np.array(state.cov_position).reshape(3, 3)  # type: ignore[union-attr]
    orientation = np.array(state.cov_orientation).reshape(3, 3)  # type: ignore[union-attr]
    assert_close(position, drawn[:3, :3])
    assert_close(orientation, drawn[3:, 3:])
    assert reasons == (conversion.CROSS_COVARIANCE_DROPPED,)


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-021")
def test_a_transformed_trajectory_includes_the_error_of_the_frame(
    rng: np.random.Generator,
) -> None:
    T_frame_home, poses = uncertain(rng), [uncertain(rng) for _ in range(3)]
    trajectory = PoseTrajectory.from_arrays(
        np.arange(3) * S,
        np.stack([p.matrix for p in poses]),
        np.stack([p.covariance for p in poses]),  # type: ignore[misc]
        parent="home",
        child="base",
    )
    transformed = conversion.trajectory_in(trajectory, T_frame_home, "frame")
    frames = draws(T_frame_home, rng)
    for i, pose in enumerate(poses):
        assert transformed.covariances is not None
        assert_close(
            transformed.covariances[i], sample_covariance(frames @ draws(pose, rng), transformed.matrices[i])
        )


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-021")
def test_the_corner_of_a_map_includes_the_frame_error_with_its_lever_arm(rng: np.random.Generator) -> None:
    geometry = GridGeometry("home", 0.5, -30.0, 40.0, 4, 4)
    layers = {n: np.zeros((4, 4), np.float32) for n in ("mean", "variance", "min", "max", "count", "age_s")}
    elevation = ElevationMap.from_layers(geometry, layers, t0_ns=S, t1_ns=S)
    T_frame_home = uncertain(rng)
    corner_pose = conversion.elevation_as_map(
        elevation, T_frame_home, "frame", ""
    ).metadata.pose_fixed_frame_map_frame
    corner = se3.transform(np.eye(3), [-30.0, 40.0, 0.0])
    drawn = sample_covariance(draws(T_frame_home, rng) @ corner, corner_pose.transform.matrix)
    assert corner_pose.transform.covariance is not None
    assert_close(corner_pose.transform.covariance, drawn)
    assert np.sqrt(drawn[0, 0]) > 0.05, "the rotation error has no lever arm of 50 m"


@pytest.mark.req("CDFF-SUP-021")
def test_the_frame_covariance_of_a_cloud_equals_the_scatter_of_its_transformed_points(
    rng: np.random.Generator,
) -> None:
    T_frame_cloud = uncertain(rng)
    assert T_frame_cloud.covariance is not None
    point = np.array([12.0, -3.0, 1.0])
    transformed = T_frame_cloud.apply(point[None])[0]
    drawn = draws(T_frame_cloud, rng) @ np.append(point, 1.0)
    errors = drawn[:, :3] - transformed
    # p' = t + dt + Exp(phi) R p: the derivative by (dt, phi) is [I, -[R p]x].
    J = np.hstack([np.eye(3), -se3.skew(T_frame_cloud.matrix[:3, :3] @ point)])
    assert_close(J @ T_frame_cloud.covariance @ J.T, errors.T @ errors / DRAWS)
