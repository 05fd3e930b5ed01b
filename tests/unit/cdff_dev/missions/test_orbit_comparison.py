# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the poses and the model of a mission in orbit, relative to the ground truth."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.types import Mesh
from cdff_dev.missions.orbit.comparison import PoseErrors, model_errors
from cdff_dev.missions.orbit.pictures import model_views
from cdff_dev.missions.orbit.script import OrbitLimits
from cdff_dev.simulate.orbit.meshes import BodyMesh, load_body


@pytest.fixture(scope="module")
def body() -> BodyMesh:
    return load_body("satellite", unit="m", material="metal", size_m=(0.1, 100.0), field="client")


def model(vertices: np.ndarray, triangles: np.ndarray) -> Mesh:
    return Mesh.from_arrays(vertices, triangles.astype(np.uint32), frame="client/body", stamp_ns=0)


def test_the_true_mesh_is_complete_and_has_no_errors(body: BodyMesh) -> None:
    result = model_errors(model(body.vertices_m, body.triangles), body, 0.02)
    assert result.rms_m < 1e-5
    assert result.completeness == 1.0
    views = model_views(result)
    assert len(set(views)) == 3
    assert all(view.startswith("data:image/png;base64,") for view in views)


def test_a_part_of_the_mesh_is_incomplete_and_a_displaced_mesh_has_its_displacement(body: BodyMesh) -> None:
    centre = body.vertices_m[body.triangles].mean(axis=1)
    half = body.triangles[centre[:, 0] > np.median(centre[:, 0])]
    assert model_errors(model(body.vertices_m, half), body, 0.02).completeness < 0.9
    far = model_errors(model(body.vertices_m + np.array([100.0, 0.0, 0.0]), body.triangles), body, 0.02)
    assert far.completeness == 0.0
    assert far.rms_m == pytest.approx(100.0, rel=0.1)


def test_errors_of_poses_are_compared_with_their_covariances(rng: np.random.Generator) -> None:
    sigmas = np.array([0.01, 0.01, 0.02, 0.002, 0.002, 0.004])
    errors = sigmas * rng.standard_normal((4000, 6))
    covariances = np.tile(np.diag(sigmas**2), (4000, 1, 1))
    statuses = ["OK"] * 4000
    poses = PoseErrors("t", np.arange(4000), np.full(4000, 10.0), errors, covariances, statuses)
    assert np.median(poses.nees) == pytest.approx(5.35, rel=0.05)
    assert poses.within_three_sigma > 0.98
    assert poses.sigma_m[0] == pytest.approx(0.02)
    assert poses.sigma_deg[0] == pytest.approx(np.degrees(0.004))
    halved = PoseErrors("t", np.arange(4000), poses.distances_m, errors, covariances / 16.0, statuses)
    assert halved.within_three_sigma < 0.9


def test_large_errors_count_as_flagged_only_if_their_pose_is_not_ok() -> None:
    errors = np.zeros((4, 6))
    errors[1, 0], errors[2, 3] = 1.0, np.pi
    covariances = np.tile(1e-4 * np.eye(6), (4, 1, 1))
    poses = PoseErrors(
        "t", np.arange(4), np.full(4, 10.0), errors, covariances, ["OK", "DEGRADED", "OK", "OK"]
    )
    assert poses.flagged_failures(OrbitLimits(position_m=0.05, rotation_deg=1.0)) == (2, 1)
