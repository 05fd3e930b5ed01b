# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lenses: as OpenCV has them, and back."""

from __future__ import annotations

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
def test_a_pinhole_projects_as_opencv_does_and_its_rays_lead_back(
    rng: np.random.Generator, distortion: tuple[float, ...]
) -> None:
    camera, seen = CameraModel(480, 640, 500.0, 510.0, 320.0, 240.0, distortion), points(rng)
    theirs, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), camera.matrix, np.array(distortion or (0.0,) * 4))
    assert camera.project(seen) == pytest.approx(theirs[:, 0], abs=1e-9)
    rays = camera.rays(camera.project(seen))
    assert rays == pytest.approx(seen / np.linalg.norm(seen, axis=1, keepdims=True), abs=1e-9)


def test_a_fisheye_projects_as_opencv_does_and_sees_to_the_sides(rng: np.random.Generator) -> None:
    camera, seen = CameraModel(480, 640, 300.0, 301.0, 320.0, 240.0, FISHEYE, fisheye=True), points(rng)
    theirs, _ = cv2.fisheye.projectPoints(seen[:, None], np.zeros(3), np.zeros(3), camera.matrix, np.array(FISHEYE))
    assert camera.project(seen) == pytest.approx(theirs[:, 0], abs=1e-9)
    wide = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, -0.3]])
    assert camera.rays(camera.project(wide)) == pytest.approx(wide / np.linalg.norm(wide, axis=1, keepdims=True))


def test_what_lies_behind_or_outside_the_lens_is_not_seen() -> None:
    pinhole = CameraModel(0, 0, 500.0, 500.0, 320.0, 240.0, PINHOLES[1])
    assert np.isnan(pinhole.project([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])).all()
    fisheye = CameraModel(0, 0, 300.0, 300.0, 320.0, 240.0, FISHEYE, fisheye=True)
    assert np.isnan(fisheye.project([[0.0, 0.0, -1.0]])).all()
    assert np.isnan(fisheye.rays([[1e5, 0.0]])).all()


def test_the_camera_of_an_image_is_what_it_says() -> None:
    K = [[500.0, 0.0, 2.0], [0.0, 500.0, 1.0], [0.0, 0.0, 1.0]]
    frame = Frame.from_image(np.zeros((3, 5), np.uint8), stamp_ns=0, camera_matrix=K, dist_coeffs=(0.1, 0, 0, 0, 0))
    camera = CameraModel.of_frame(frame)
    assert (camera.rows, camera.cols, camera.fx, camera.distortion) == (3, 5, 500.0, (0.1, 0.0, 0.0, 0.0, 0.0))
    assert not camera.is_ideal
    with pytest.raises(InputError, match="CAM_UNDEF"):
        CameraModel.of_frame(Frame.from_image(np.zeros((3, 5), np.uint8), stamp_ns=0))


@pytest.mark.parametrize(
    ("matrix", "distortion", "fisheye"),
    [
        ([[500.0, 1.0, 2.0], [0.0, 500.0, 1.0], [0.0, 0.0, 1.0]], (), False),
        ([[0.0, 0.0, 2.0], [0.0, 500.0, 1.0], [0.0, 0.0, 1.0]], (), False),
        (np.eye(3), (0.1, 0.2, 0.3), False),
        (np.eye(3), (0.1, 0.2, 0.3, 0.0, 0.1), True),
        (np.eye(3), (np.nan, 0.0, 0.0, 0.0), False),
    ],
)
def test_what_is_no_camera_is_refused(matrix: object, distortion: tuple[float, ...], fisheye: bool) -> None:
    with pytest.raises(InputError):
        CameraModel.from_matrix(np.asarray(matrix), distortion, fisheye=fisheye)


def test_zeros_that_pad_the_coefficients_are_left_out() -> None:
    padded = CameraModel.from_matrix(np.eye(3), (0.1, 0.2, 0.0, 0.0, 0.0, 0.0))
    assert padded.distortion == (0.1, 0.2, 0.0, 0.0, 0.0)
    assert CameraModel.from_matrix(np.eye(3), np.zeros(14)).is_ideal
