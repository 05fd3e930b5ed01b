# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ExtrapolationError, InputError
from cdff_common.geometry import UncertainTransform, interpolate, se3
from cdff_common.geometry.se3 import skew
from cdff_core.dfns.point_cloud_deskewing.interface import (
    PointCloudDeskewingInputs,
    PointCloudDeskewingOutputs,
)
from cdff_core.dfns.point_cloud_deskewing.pose_interpolation import PoseInterpolation

POSE_STAMPS_NS = np.array([0, 50_000_000, 120_000_000, 200_000_000])


def random_poses(rng: np.random.Generator, n: int = 4) -> tuple[np.ndarray, np.ndarray]:
    T = [se3.exp_se3(rng.normal(0.0, 0.4, 6))]
    for _ in range(n - 1):
        T.append(T[-1] @ se3.exp_se3(rng.normal(0.0, 0.1, 6)))
    A = rng.normal(0.0, 0.05, (n, 6, 6))
    return np.array(T), A @ np.swapaxes(A, 1, 2)


def run(points: np.ndarray, stamps: np.ndarray, trajectory: dict[str, Any]) -> PointCloudDeskewingOutputs:
    node = PoseInterpolation()
    node.configure({"max_gap_s": 0.1})
    return node.process(PointCloudDeskewingInputs(points=points, stamps_ns=stamps, **trajectory))


def trajectory(
    T: np.ndarray, C: np.ndarray | None, pose_stamps: np.ndarray = POSE_STAMPS_NS
) -> dict[str, Any]:
    return {"poses": T, "pose_stamps_ns": pose_stamps, "pose_covariances": C}


def test_each_point_is_transformed_by_the_pose_interpolated_to_its_time(rng: np.random.Generator) -> None:
    T, C = random_poses(rng)
    points, stamps = rng.normal(0.0, 5.0, (60, 3)), rng.integers(0, 200_001, 60) * 1000
    outputs = run(points, stamps, trajectory(T, C))
    for p, t, q, variance in zip(points, stamps, outputs.points, outputs.height_variance, strict=True):
        k = min(int(np.searchsorted(POSE_STAMPS_NS, t, side="right")) - 1, 2)
        a, b = (UncertainTransform(T[i], C[i]) for i in (k, k + 1))
        pose = interpolate(a, b, (t - POSE_STAMPS_NS[k]) / (POSE_STAMPS_NS[k + 1] - POSE_STAMPS_NS[k]))
        np.testing.assert_allclose(q, pose.apply(p[None])[0], atol=1e-9)
        J = np.hstack([np.eye(3), -skew(pose.matrix[:3, :3] @ p)])
        assert variance == pytest.approx((J @ pose.covariance @ J.T)[2, 2], rel=1e-9)


def test_points_at_the_times_of_poses_are_transformed_even_next_to_a_gap(rng: np.random.Generator) -> None:
    T, C = random_poses(rng, 2)
    distant_poses = trajectory(T, C, np.array([0, 10_000_000_000]))
    outputs = run(np.ones((2, 3)), np.array([0, 10_000_000_000]), distant_poses)
    np.testing.assert_allclose(outputs.points, (T @ [1, 1, 1, 1])[:, :3], atol=1e-12)
    with pytest.raises(ExtrapolationError, match="apart"):
        run(np.ones((1, 3)), np.array([5_000_000_000]), distant_poses)


def test_a_single_pose_transforms_only_points_of_its_time(rng: np.random.Generator) -> None:
    T, C = random_poses(rng, 1)
    single = trajectory(T, C, np.array([7000]))
    np.testing.assert_allclose(
        run(np.ones((1, 3)), np.array([7000]), single).points[0], (T[0] @ [1, 1, 1, 1])[:3]
    )
    with pytest.raises(ExtrapolationError):
        run(np.ones((1, 3)), np.array([8000]), single)


def test_poses_without_covariance_leave_the_variance_unknown(rng: np.random.Generator) -> None:
    outputs = run(np.ones((3, 3)), np.array([0, 1000, 2000]), trajectory(random_poses(rng)[0], None))
    assert np.isnan(outputs.height_variance).all()
    assert np.isfinite(outputs.points).all()


def test_stamps_outside_the_poses_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(ExtrapolationError, match="enclose"):
        run(np.ones((1, 3)), np.array([200_001_000]), trajectory(*random_poses(rng)))


def test_no_points_give_no_points_and_missing_stamps_are_refused(rng: np.random.Generator) -> None:
    poses = trajectory(*random_poses(rng))
    assert run(np.empty((0, 3)), np.empty(0, np.int64), poses).points.shape == (0, 3)
    with pytest.raises(InputError, match="stamp"):
        run(np.ones((2, 3)), np.zeros(1, np.int64), poses)
    with pytest.raises(InputError, match="poses: none"):
        run(
            np.ones((1, 3)),
            np.zeros(1, np.int64),
            trajectory(np.empty((0, 4, 4)), None, np.empty(0, np.int64)),
        )
