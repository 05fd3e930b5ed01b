# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Projection and rays of the camera model agree with OpenCV."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.types import Frame

PINHOLES = [
    (),
    (-0.22, 0.06, -3.5e-4, -1.5e-4),
    (-0.3, 0.1, 1e-3, -5e-4, -0.01),
    (0.5, -0.2, 1e-4, 2e-4, 0.03, 0.6, -0.15, 0.02),
    (-0.2, 0.05, 1e-4, 2e-4, 0.0, 0.01, 0.0, 0.0, 1e-3, -2e-4, 5e-4, 1e-4),
]
FISHEYE = (-0.01, 0.02, -0.003, 0.0005)


def points(rng: np.random.Generator, n: int = 500) -> np.ndarray:
    return rng.uniform([-3.0, -2.0, 3.0], [3.0, 2.0, 9.0], (n, 3))


@pytest.mark.parametrize("distortion", PINHOLES)
def test_a_pinhole_projects_like_opencv_and_its_rays_point_to_the_points(
    rng: np.random.Generator, distortion: tuple[float, ...]
) -> None:
    camera, points_camera = CameraModel(480, 640, 500.0, 510.0, 320.0, 240.0, distortion), points(rng)
    of_opencv, _ = cv2.projectPoints(
        points_camera, np.zeros(3), np.zeros(3), camera.matrix, np.array(distortion or (0.0,) * 4)
    )
    assert camera.project(points_camera) == pytest.approx(of_opencv[:, 0], abs=1e-9)
    rays = camera.rays(camera.project(points_camera))
    assert rays == pytest.approx(
        points_camera / np.linalg.norm(points_camera, axis=1, keepdims=True), abs=1e-9
    )


def test_a_fisheye_projects_like_opencv_and_has_a_wide_field_of_view(rng: np.random.Generator) -> None:
    camera, points_camera = (
        CameraModel(480, 640, 300.0, 301.0, 320.0, 240.0, FISHEYE, lens="fisheye"),
        points(rng),
    )
    of_opencv, _ = cv2.fisheye.projectPoints(
        points_camera[:, None], np.zeros(3), np.zeros(3), camera.matrix, np.array(FISHEYE)
    )
    assert camera.project(points_camera) == pytest.approx(of_opencv[:, 0], abs=1e-9)
    wide = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, -0.3]])
    assert camera.rays(camera.project(wide)) == pytest.approx(
        wide / np.linalg.norm(wide, axis=1, keepdims=True)
    )


def test_points_behind_or_outside_the_lens_are_not_visible() -> None:
    pinhole = CameraModel(0, 0, 500.0, 500.0, 320.0, 240.0, PINHOLES[1])
    assert np.isnan(pinhole.project([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])).all()
    fisheye = CameraModel(0, 0, 300.0, 300.0, 320.0, 240.0, FISHEYE, lens="fisheye")
    assert np.isnan(fisheye.project([[0.0, 0.0, -1.0]])).all()
    assert np.isnan(fisheye.rays([[1e5, 0.0]])).all()


def test_the_camera_of_an_image_matches_its_metadata() -> None:
    K = [[500.0, 0.0, 2.0], [0.0, 500.0, 1.0], [0.0, 0.0, 1.0]]
    frame = Frame.from_image(
        np.zeros((3, 5), np.uint8), stamp_ns=0, camera_matrix=K, dist_coeffs=(0.1, 0, 0, 0, 0)
    )
    camera = CameraModel.of_frame(frame)
    assert (camera.rows, camera.cols, camera.fx, camera.distortion) == (
        3,
        5,
        500.0,
        (0.1, 0.0, 0.0, 0.0, 0.0),
    )
    assert not camera.is_ideal
    with pytest.raises(InputError, match="CAM_UNDEF"):
        CameraModel.of_frame(Frame.from_image(np.zeros((3, 5), np.uint8), stamp_ns=0))


@pytest.mark.parametrize(
    ("matrix", "distortion", "lens"),
    [
        ([[500.0, 1.0, 2.0], [0.0, 500.0, 1.0], [0.0, 0.0, 1.0]], (), "pinhole"),
        ([[0.0, 0.0, 2.0], [0.0, 500.0, 1.0], [0.0, 0.0, 1.0]], (), "pinhole"),
        (np.eye(3), (0.1, 0.2, 0.3), "pinhole"),
        (np.eye(3), (0.1, 0.2, 0.3, 0.0, 0.1), "fisheye"),
        (np.eye(3), (np.nan, 0.0, 0.0, 0.0), "pinhole"),
        (np.eye(3), (-0.5, 0.0, 0.0, 0.0, 0.0), "omnidirectional"),
        (np.eye(3), (), "omnidirectional"),
        (np.eye(3), (0.0,), "fov"),
        (np.eye(3), (-0.1, 0.1), "division"),
        (np.eye(3), (), "mirror"),
    ],
)
def test_an_invalid_camera_is_refused(matrix: object, distortion: tuple[float, ...], lens: Any) -> None:
    with pytest.raises(InputError):
        CameraModel.from_matrix(np.asarray(matrix), distortion, lens=lens)


def test_zero_padding_of_the_coefficients_is_removed() -> None:
    padded = CameraModel.from_matrix(np.eye(3), (0.1, 0.2, 0.0, 0.0, 0.0, 0.0))
    assert padded.distortion == (0.1, 0.2, 0.0, 0.0, 0.0)
    assert CameraModel.from_matrix(np.eye(3), np.zeros(14)).is_ideal


WIDE: list[tuple[Any, tuple[float, ...]]] = [
    ("omnidirectional", (0.8, -0.1, 0.02, 1e-4, -2e-4)),
    ("omnidirectional", (1.6, -0.1, 0.02, 1e-4, -2e-4)),
    ("omnidirectional", (0.0,)),
    ("fov", (0.93,)),
    ("division", (-0.25,)),
    ("division", (0.02,)),
]


@pytest.mark.parametrize(("lens", "distortion"), WIDE)
def test_the_rays_of_every_lens_point_to_the_projected_points(
    rng: np.random.Generator, lens: Any, distortion: tuple[float, ...]
) -> None:
    camera, points_camera = CameraModel(480, 640, 300.0, 301.0, 320.0, 240.0, distortion, lens), points(rng)
    directions = points_camera / np.linalg.norm(points_camera, axis=1, keepdims=True)
    assert camera.rays(camera.project(points_camera)) == pytest.approx(directions, abs=1e-9)
    assert camera.project([[0.0, 0.0, 2.0]])[0] == pytest.approx([320.0, 240.0])


@pytest.mark.parametrize(("lens", "distortion"), [*WIDE, ("pinhole", PINHOLES[2]), ("fisheye", FISHEYE)])
def test_a_message_carries_every_lens(lens: Any, distortion: tuple[float, ...]) -> None:
    camera = CameraModel(3, 5, 500.0, 501.0, 2.0, 1.0, distortion, lens)
    frame = Frame.from_image(
        np.zeros((3, 5), np.uint8),
        stamp_ns=0,
        camera_matrix=camera.matrix,
        dist_coeffs=camera.message_coefficients,
        camera_model=camera.message_model,
    )
    assert CameraModel.of_frame(frame) == camera


def test_an_omnidirectional_lens_without_distortion_has_the_stated_view() -> None:
    # Above xi = 1 the view ends where the line to the image is a tangent of the sphere.
    camera = CameraModel(0, 0, 200.0, 200.0, 0.0, 0.0, (2.0,), "omnidirectional")
    angles = np.deg2rad([100.0, 119.0, 121.0])
    pixels = camera.project(np.column_stack([np.sin(angles), 0.0 * angles, np.cos(angles)]))
    assert np.isfinite(pixels[:2]).all()
    assert np.isnan(pixels[2]).all()


def test_pixels_outside_the_image_of_a_lens_have_no_ray() -> None:
    fov = CameraModel(0, 0, 200.0, 200.0, 0.0, 0.0, (1.0,), "fov")
    assert np.isnan(fov.rays([[200.0 * 1.6, 0.0]])).all()
    division = CameraModel(0, 0, 200.0, 200.0, 0.0, 0.0, (-0.25,), "division")
    assert np.isnan(division.rays([[200.0 * 2.1, 0.0]])).all()
    mirror = CameraModel(0, 0, 200.0, 200.0, 0.0, 0.0, (2.0,), "omnidirectional")
    assert np.isnan(mirror.rays([[200.0 * 0.6, 0.0]])).all()
