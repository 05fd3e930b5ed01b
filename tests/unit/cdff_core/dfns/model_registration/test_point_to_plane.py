# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelRegistration: capture range, prediction, degenerate directions, rates within a scan, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_core.dfns.model_registration.interface import ModelRegistrationInputs, ModelRegistrationOutputs
from cdff_core.dfns.model_registration.point_to_plane import PointToPlane
from tests.support import satellite
from tests.support.prepared_satellite import prepared, surface_ports

SIGMA_M = 0.01


def scan(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return satellite.scan(satellite.satellite(), T, rng=rng, pixels=64, field_deg=20.0, sigma_m=SIGMA_M)


def register(points: np.ndarray, pose: np.ndarray, **ports: Any) -> ModelRegistrationOutputs:
    model, node = prepared(), PointToPlane()
    node.configure()
    return node.process(
        ModelRegistrationInputs(
            scan=points,
            pose=pose,
            drawn_vertices=model.drawn_vertices,
            drawn_triangles=model.drawn_triangles,
            centre_m=model.centre_m,
            sigma_m=SIGMA_M,
            **surface_ports(),
            **ports,
        )
    )


def displaced(T: np.ndarray, rotation_deg: float, distance_m: float, rng: np.random.Generator) -> np.ndarray:
    axis, direction = rng.normal(size=(2, 3))
    R = se3.exp_so3(np.radians(rotation_deg) * axis / np.linalg.norm(axis))
    shift = distance_m * direction / np.linalg.norm(direction)
    return se3.transform(R @ T[:3, :3], T[:3, 3] + shift)


def test_a_start_8_degrees_off_is_corrected_with_a_covariance_that_fits(rng: np.random.Generator) -> None:
    squared = []
    for _ in range(12):
        T = satellite.random_pose(rng, 5.0)
        outputs = register(scan(T, rng), displaced(T, 8.0, 0.05, rng))
        error = pose_error(T, outputs.pose)
        assert np.degrees(np.linalg.norm(error[3:])) < 1.0
        assert np.linalg.norm(error[:3]) < 0.015
        assert outputs.agreement > 0.9
        assert outputs.sigma_m == pytest.approx(SIGMA_M, rel=0.3)
        squared.append(error @ np.linalg.solve(outputs.covariance, error))
    assert 1.0 < np.median(squared) < 12.0


def test_a_prediction_contributes_by_its_information(rng: np.random.Generator) -> None:
    T = satellite.random_pose(rng, 5.0)
    points, start = scan(T, rng), displaced(T, 1.0, 0.01, rng)
    precise = register(points, start, prior_covariance=1e-10 * np.eye(6))
    np.testing.assert_allclose(precise.pose, start, atol=1e-3)
    loose = register(points, start, prior_covariance=np.eye(6))
    assert np.linalg.norm(pose_error(T, loose.pose)) < 0.2 * np.linalg.norm(pose_error(T, start))
    np.testing.assert_allclose(
        np.linalg.inv(loose.covariance), loose.information + np.eye(6), rtol=1e-3, atol=1.0
    )


def test_a_plane_leaves_three_directions_to_the_prediction(rng: np.random.Generator) -> None:
    T = se3.transform(se3.exp_so3([np.pi, 0.0, 0.0]), [0.0, 0.0, 5.0])
    points = scan(T, rng)
    nearest = points[:, 2] < np.quantile(points[:, 2], 0.02) + 0.05
    middle = np.linalg.norm(points[:, :2] - np.median(points[nearest, :2], axis=0), axis=1) < 0.25
    prior = np.diag([0.01**2] * 6)
    outputs = register(points[nearest & middle], T, prior_covariance=prior, capture_m=0.05)
    assert len(outputs.weak_directions) == 3
    for row in np.eye(6)[[0, 1, 5]]:
        assert np.linalg.norm(outputs.weak_directions @ row) > 0.9
    sigmas = np.sqrt(np.diag(outputs.covariance))
    assert sigmas[2] < 0.003
    assert sigmas[5] == pytest.approx(0.01, rel=0.05)


def test_points_with_times_determine_the_rate(rng: np.random.Generator) -> None:
    T = satellite.random_pose(rng, 5.0)
    points = scan(T, rng)
    times_s = np.linspace(-1.0, 0.0, len(points))
    rate = np.radians([0.0, 0.0, 2.0])
    origin = T[:3, 3]
    moved_points = points + times_s[:, None] * np.cross(rate, points - origin)
    prior = np.diag([0.02**2] * 6 + [0.02**2] * 3 + [0.1**2] * 3)
    outputs = register(
        moved_points, T, times_s=times_s, prior_covariance=prior, state_jacobian=np.eye(12), capture_m=0.1
    )
    np.testing.assert_allclose(outputs.correction[9:], rate, atol=0.004)
    assert np.sqrt(np.diag(outputs.covariance))[9:].max() < 0.01


def test_wrong_sizes_and_points_elsewhere_are_refused(rng: np.random.Generator) -> None:
    T = satellite.random_pose(rng, 5.0)
    points = scan(T, rng)
    with pytest.raises(InputError, match="times_s"):
        register(points, T, times_s=np.zeros(3))
    with pytest.raises(InputError, match="expected 6 errors"):
        register(points, T, prior_covariance=np.eye(7))
    with pytest.raises(RefusedError) as refused:
        register(points + np.array([3.0, 0.0, 0.0]), T)
    assert refused.value.reasons == ("no_overlap",)
    with pytest.raises(RefusedError) as empty:
        register(np.zeros((0, 3)), T)
    assert empty.value.reasons == ("no_overlap",)
    with pytest.raises(RefusedError) as inside:
        register(points, se3.transform(T[:3, :3], np.zeros(3)))
    assert inside.value.reasons == ("sensor_inside",)
