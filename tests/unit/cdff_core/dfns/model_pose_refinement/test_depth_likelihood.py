# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelPoseRefinement: the best pose first, smaller errors, noise, covariance in the frame of the sensor."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_core.dfns.model_pose_refinement.depth_likelihood import DepthLikelihood
from cdff_core.dfns.model_pose_refinement.interface import (
    ModelPoseRefinementInputs,
    ModelPoseRefinementOutputs,
)
from tests.support import satellite
from tests.support.prepared_satellite import prepared, surface_ports


def refine(
    scan: np.ndarray, poses: np.ndarray, sigma_m: float = 0.01, *, estimate: bool = False
) -> ModelPoseRefinementOutputs:
    model, node = prepared(), DepthLikelihood()
    node.configure()
    return node.process(
        ModelPoseRefinementInputs(
            scan=scan,
            poses=poses,
            drawn_vertices=model.drawn_vertices,
            drawn_triangles=model.drawn_triangles,
            centre_m=model.centre_m,
            sigma_m=sigma_m,
            sigma_is_upper_bound=estimate,
            **surface_ports(),
        )
    )


def scan_at(T: np.ndarray, rng: np.random.Generator, sigma_m: float = 0.01) -> np.ndarray:
    return satellite.scan(satellite.satellite(), T, pixels=64, field_deg=20.0, sigma_m=sigma_m, rng=rng)


def hypotheses(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return rotations of the pose by 180°, and the pose with a small error as the last one."""
    turns = se3.exp_so3(np.pi * np.eye(3))
    wrong = [T @ se3.transform(R, np.zeros(3)) for R in turns]
    near = T @ se3.transform(se3.exp_so3(np.radians(rng.normal(0, 0.4, 3))), rng.normal(0, 0.003, 3))
    return np.stack([*wrong, near])


def test_the_right_pose_is_first_and_becomes_more_accurate(rng: np.random.Generator) -> None:
    for _ in range(3):
        T = satellite.random_pose(rng, 5.0)
        outputs = refine(scan_at(T, rng), hypotheses(T, rng))
        error = pose_error(T, outputs.poses[0])
        assert np.degrees(np.linalg.norm(error[3:])) < 0.8
        assert np.linalg.norm(error[:3]) < 0.008
        assert (np.diff(outputs.costs) >= 0.0).all()
        agree, other, missed, free = outputs.rays[0]
        assert agree > 0.9 * (agree + other + missed + free)
        assert error @ np.linalg.solve(outputs.covariances[0], error) < 60.0


def test_the_noise_is_estimated_below_the_upper_bound(rng: np.random.Generator) -> None:
    T = satellite.random_pose(rng, 5.0)
    outputs = refine(scan_at(T, rng, 0.02), hypotheses(T, rng), 0.2, estimate=True)
    assert outputs.sigma_m == pytest.approx(0.02, rel=0.2)
    assert refine(scan_at(T, rng), hypotheses(T, rng), 0.05).sigma_m == pytest.approx(0.05, rel=0.01)


def test_the_covariance_turns_with_the_sensor(rng: np.random.Generator) -> None:
    T = satellite.random_pose(rng, 5.0)
    scan, R = scan_at(T, rng), se3.transform(se3.exp_so3([0.4, -1.0, 0.7]), np.zeros(3))
    first = refine(scan, T[None])
    second = refine(se3.transform_points(R, scan), (R @ T)[None])
    sigmas = [np.sqrt(np.trace(outputs.covariances[0][:3, :3])) for outputs in (first, second)]
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.5)
    assert np.linalg.eigvalsh(first.covariances[0])[0] > 0.0


def test_points_around_the_sensor_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(RefusedError) as error:
        refine(rng.normal(size=(100, 3)), np.eye(4)[None])
    assert error.value.reasons == ("sensor_inside",)
