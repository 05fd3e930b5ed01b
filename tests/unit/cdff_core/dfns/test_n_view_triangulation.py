# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_core.dfns.n_view_triangulation.interface import NViewTriangulationInputs, NViewTriangulationOutputs
from cdff_core.dfns.n_view_triangulation.linear_then_reprojection import LinearThenReprojection
from evaluation.triangulation import scene

CAMERA = [700.0, 700.0, 320.0, 240.0]


def solve(problem: BundleProblem, **config: object) -> NViewTriangulationOutputs:
    dfn = LinearThenReprojection()
    dfn.configure(config)
    return dfn.process(NViewTriangulationInputs(tracks=problem))


def two_cameras(points: list[list[float]], pixels: list[list[float]] | None = None) -> BundleProblem:
    T = np.stack([np.eye(4), se3.transform(np.eye(3), [1.0, 0.0, 0.0])])
    n = len(points)
    if pixels is None:
        K = np.array([[700.0, 0, 320], [0, 700.0, 240], [0, 0, 1]])
        projections = [se3.transform_points(np.linalg.inv(t), np.array(points)) @ K.T for t in T]
        pixels = np.stack([s[:, :2] / s[:, 2:] for s in projections], axis=1).reshape(-1, 2).tolist()
    return BundleProblem.from_arrays(
        T, CAMERA, np.zeros((n, 3)), (np.tile([0, 1], n), np.repeat(np.arange(n), 2)), pixels, frame="site"
    )


@pytest.mark.parametrize("views", [2, 3, 5])
def test_errors_are_consistent_with_the_covariances(views: int) -> None:
    problem, truth = scene(views, (4.0, 30.0), 3000)
    outputs = solve(problem, min_angle_deg=0.0)
    assert outputs.valid.mean() > 0.99
    error = (outputs.points - truth)[outputs.valid]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(outputs.covariances[outputs.valid]), error) / 3.0
    assert 0.93 < nees.mean() < 1.07
    assert 0.9 < outputs.unit_variance < 1.1


def test_the_reprojection_error_is_at_its_minimum() -> None:
    problem, _ = scene(3, (4.0, 30.0), 200)
    outputs = solve(problem, min_angle_deg=0.0)
    T = np.linalg.inv(problem.cameras.matrices)
    pixels = problem.observations.pixels[:, :2].reshape(-1, 3, 2)

    def cost(points: np.ndarray) -> np.ndarray:
        total = np.zeros(len(points))
        for i in range(3):
            p = se3.transform_points(T[i], points)
            total += ((p[:, :2] / p[:, 2:] * 700.0 + [320.0, 240.0] - pixels[:, i]) ** 2).sum(axis=1)
        return total

    np.testing.assert_allclose(outputs.rms_px, np.sqrt(cost(outputs.points) / 3.0), rtol=1e-6, atol=1e-9)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            assert (cost(outputs.points + sign * 1e-4 * np.eye(3)[axis]) >= cost(outputs.points) - 1e-6).all()


def test_each_invalid_point_has_a_status() -> None:
    problem = two_cameras(
        [[0.0, 0, 5], [0.0, 0, -5], [0.0, 0, 4000], [0.0, 0, 5]],
        [[320, 240], [180, 240], [320, 240], [460, 240], [320, 240], [319.8, 240], [320, 240], [180, 290]],
    )
    outputs = solve(problem)
    assert outputs.status.tolist() == [0, 3, 4, 5]
    assert outputs.valid.tolist() == [True, False, False, False]
    assert outputs.points[0] == pytest.approx([0.0, 0.0, 5.0])
    assert outputs.points[1, 2] < 0.0


def test_a_problem_of_points_with_a_single_view_or_a_single_ray_is_refused() -> None:
    T = np.tile(np.eye(4), (2, 1, 1))
    problem = BundleProblem.from_arrays(
        T, CAMERA, np.zeros((2, 3)), ([0, 0, 1], [0, 1, 1]), [[320.0, 240]] * 3, frame="site"
    )
    with pytest.raises(RefusedError) as refusal:
        solve(problem)
    assert refusal.value.reasons[0] == "no_points"


def test_lens_distortion_is_corrected() -> None:
    lens = [700.0, 690.0, 320.0, 240.0, -0.2, 0.05, 0.001, -0.002, 0.01]
    camera = CameraModel.from_matrix([[700.0, 0, 320], [0, 690.0, 240], [0, 0, 1]], lens[4:])
    points = np.array([[0.5, -0.4, 4.0], [1.0, 0.8, 6.0], [-0.5, 0.2, 5.0]])
    T = np.stack([np.eye(4), se3.transform(se3.exp_so3([0.0, 0.05, 0.0]), [0.8, 0.0, 0.1])])
    pixels = np.stack([camera.project(se3.transform_points(np.linalg.inv(t), points)) for t in T], axis=1)
    problem = BundleProblem.from_arrays(
        T,
        lens,
        np.zeros((3, 3)),
        (np.tile([0, 1], 3), np.repeat(np.arange(3), 2)),
        pixels.reshape(-1, 2),
        frame="site",
    )
    assert solve(problem).points == pytest.approx(points, abs=1e-6)


def test_each_camera_has_its_own_lens() -> None:
    lenses = np.array([[700.0, 690.0, 320.0, 240.0], [400.0, 410.0, 200.0, 150.0]])
    points = np.array([[0.5, -0.4, 4.0], [1.0, 0.8, 6.0]])
    T = np.stack([np.eye(4), se3.transform(np.eye(3), [0.8, 0.0, 0.1])])
    pixels = []
    for t, (fx, fy, cx, cy) in zip(T, lenses, strict=True):
        p = se3.transform_points(np.linalg.inv(t), points)
        pixels.append(p[:, :2] / p[:, 2:] * [fx, fy] + [cx, cy])
    observations = (np.tile([0, 1], 2), np.repeat([0, 1], 2))
    problem = BundleProblem.from_arrays(
        T,
        lenses,
        np.zeros((2, 3)),
        observations,
        np.stack(pixels, axis=1).reshape(-1, 2),
        frame="site",
        lens_of_camera=[0, 1],
    )
    assert solve(problem).points == pytest.approx(points, abs=1e-6)


def test_a_lens_without_focal_length_and_no_cameras_are_refused() -> None:
    with pytest.raises(InputError, match="cameras"):
        solve(BundleProblem())
    problem = BundleProblem.from_arrays(
        [np.eye(4)], [0.0] * 4, [[0, 0, 0]], ([0], [0]), [[1.0, 2.0]], frame="site"
    )
    with pytest.raises(InputError, match="focal"):
        solve(problem)


def test_the_lens_without_focal_length_is_named() -> None:
    problem = BundleProblem.from_arrays(
        np.tile(np.eye(4), (2, 1, 1)),
        [CAMERA, [0.0] * 4],
        [[0, 0, 5]],
        ([0, 1], [0, 0]),
        [[320.0, 240.0]] * 2,
        frame="site",
        lens_of_camera=[0, 1],
    )
    with pytest.raises(InputError, match="lens 1"):
        solve(problem)
