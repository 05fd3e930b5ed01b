# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Undistortion and stereo rectification: images match their ideal cameras, pairs have common rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.camera import CameraModel, StereoCalibration, read_stereo
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Frame, FramePair
from cdff_core.dfns.image_undistortion.interface import ImageUndistortionInputs
from cdff_core.dfns.image_undistortion.lens_map import LensMap as Undistortion
from cdff_core.dfns.stereo_rectification.interface import StereoRectificationInputs
from cdff_core.dfns.stereo_rectification.lens_map import LensMap as Rectification
from cdff_core.imaging import rectification

LEFT = CameraModel(300, 400, 260.0, 262.0, 205.0, 148.0, (-0.25, 0.07, 5e-4, -3e-4))
RIGHT = CameraModel(300, 400, 258.0, 259.0, 196.0, 153.0, (-0.24, 0.06, -4e-4, 2e-4))
FISHEYE = CameraModel(300, 400, 220.0, 220.0, 200.0, 150.0, (-0.01, 0.02, -0.003, 0.0005), lens="fisheye")
R = se3.exp_so3([0.02, -0.03, 0.015])
STEREO = StereoCalibration.from_parts(LEFT, RIGHT, R, [-0.25, 0.004, -0.003])


def draw(camera: CameraModel, points_m: np.ndarray) -> np.ndarray:
    """Return an image with dots of 2 px at the projections of points, with sub-pixel positions."""
    image = np.zeros((camera.rows, camera.cols), np.uint8)
    for x, y in camera.project(points_m):
        if np.isfinite([x, y]).all():
            centre = (round(x * 16), round(y * 16))
            cv2.circle(image, centre, 2 * 16, 255, cv2.FILLED, cv2.LINE_AA, shift=4)
    return image


def dots(image: np.ndarray) -> np.ndarray:
    """Return the centres of the dots in an image."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats((image > 40).astype(np.uint8))
    results = []
    for label in range(1, len(stats)):
        rows, cols = np.nonzero(labels == label)
        weight = image[rows, cols].astype(float)
        results.append([np.average(cols, weights=weight), np.average(rows, weights=weight)])
    return np.array(results)


def frame(
    camera: CameraModel, image: np.ndarray, T_base_camera: np.ndarray, name: str = "mana/left"
) -> Frame:
    return Frame.from_image(
        image,
        stamp_ns=7000,
        camera_matrix=camera.matrix,
        dist_coeffs=camera.message_coefficients,
        camera_model=camera.message_model,
        sensor=name,
        T_robot_sensor=UncertainTransform(T_base_camera, np.eye(6) * 1e-6),
    )


def wall(z_m: float = 3.0, half_m: float = 1.4, n: int = 9) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-half_m, half_m, n), np.linspace(-half_m * 0.7, half_m * 0.7, n))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z_m)])


@pytest.mark.parametrize("keep", [0.0, 0.5, 1.0])
def test_a_camera_without_distortion_is_its_own_ideal_camera(keep: float) -> None:
    camera = CameraModel(300, 400, 260.0, 260.0, 170.0, 160.0)
    ideal = rectification.undistorted(camera, keep).camera
    assert (ideal.rows, ideal.cols) == (300, 400)
    assert [ideal.fx, ideal.fy, ideal.cx, ideal.cy] == pytest.approx([260.0, 260.0, 170.0, 160.0], abs=1e-6)


LENSES = [
    LEFT,
    FISHEYE,
    CameraModel(300, 400, 260.0, 262.0, 205.0, 148.0, (0.5, -0.2, 1e-4, 2e-4, 0.03, 0.6, -0.15, 0.02)),
    CameraModel(300, 400, 420.0, 421.0, 203.0, 149.0, (0.9, -0.1, 0.02, 1e-4, -2e-4), "omnidirectional"),
    CameraModel(300, 400, 230.0, 231.0, 203.0, 149.0, (0.9,), "fov"),
    CameraModel(300, 400, 250.0, 251.0, 203.0, 149.0, (-0.2,), "division"),
]


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.lens)
def test_an_undistorted_image_matches_its_new_camera(camera: CameraModel) -> None:
    node = Undistortion()
    node.configure({"keep": 0.0})
    points = wall()
    outputs = node.process(
        ImageUndistortionInputs(image=frame(camera, draw(camera, points), np.eye(4)))
    ).image
    ideal = CameraModel.of_frame(outputs)
    assert ideal.is_ideal
    assert outputs.stamp_ns == 7000
    detected = dots(outputs.image)
    expected = ideal.project(points)
    nearest = np.linalg.norm(detected[:, None] - expected[None], axis=2).min(axis=1)
    assert len(detected) >= 25
    assert np.median(nearest) < 0.2


def test_keep_selects_a_crop_between_valid_pixels_only_and_all_pixels() -> None:
    white = np.full((300, 400), 255, np.uint8)
    valid_fractions, focal = [], []
    for keep in (0.0, 0.5, 1.0):
        node = Undistortion()
        node.configure({"keep": keep, "interpolation": "nearest"})
        outputs = node.process(ImageUndistortionInputs(image=frame(LEFT, white, np.eye(4)))).image
        valid_fractions.append(float((outputs.image == 255).mean()))
        focal.append(float(outputs.camera_matrix[0, 0]))
    assert valid_fractions[0] > 0.999
    assert valid_fractions[0] > valid_fractions[1] > valid_fractions[2]
    assert focal[0] > focal[1] > focal[2]


T_BASE_LEFT = se3.transform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), [0.3, 0.1, 0.9])


def rectified_pair(
    points_m: np.ndarray, keep: float = 0.0, T_base_left: np.ndarray = T_BASE_LEFT
) -> FramePair:
    T_right_left = STEREO.T_right_left
    in_right = points_m @ T_right_left[:3, :3].T + T_right_left[:3, 3]
    raw = FramePair(
        baseline=0.0,
        left=frame(LEFT, draw(LEFT, points_m), T_base_left),
        right=frame(RIGHT, draw(RIGHT, in_right), T_base_left @ se3.inverse(T_right_left), "mana/right"),
    )
    node = Rectification()
    node.configure({"keep": keep})
    return node.process(StereoRectificationInputs(pair=raw)).pair


def test_a_rectified_pair_has_common_rows_and_disparity_gives_depth() -> None:
    pair = rectified_pair(wall())
    assert pair.baseline == pytest.approx(STEREO.baseline_m)
    assert (pair.left.camera_matrix == pair.right.camera_matrix).all()
    left, right = dots(pair.left.image), dots(pair.right.image)
    fx = pair.left.camera_matrix[0, 0]
    expected_px = fx * pair.baseline / 3.0
    differences_px = right[None] - left[:, None] + [expected_px, 0.0]
    best = np.abs(differences_px).max(axis=2).argmin(axis=1)
    best_px = differences_px[np.arange(len(left)), best]
    close = np.abs(best_px).max(axis=1) < 3.0
    assert close.sum() >= 20
    assert np.abs(np.median(best_px[close], axis=0)) == pytest.approx([0.0, 0.0], abs=0.15)
    assert np.percentile(np.abs(best_px[close][:, 1]), 90) < 0.3


def test_the_rectified_cameras_have_equal_orientation_and_the_baseline_along_x() -> None:
    pair = rectified_pair(wall())
    T_left, T_right = pair.left.T_robot_sensor, pair.right.T_robot_sensor
    assert T_left is not None
    assert T_right is not None
    assert pair.left.frame == "mana/left_rectified"
    T = se3.inverse(T_left.matrix) @ T_right.matrix
    assert pytest.approx(se3.transform(np.eye(3), [pair.baseline, 0.0, 0.0]), abs=1e-9) == T


def test_a_real_rovers_raw_calibration_gives_common_rows(real_data: Callable[[str], Path]) -> None:
    stereo = read_stereo(next(real_data("cdff_upstream/MinnieStereo").glob("*.yml")))
    left, right, baseline_m = rectification.rectified(stereo)
    rng = np.random.default_rng(3)
    points = rng.uniform([-2.0, -1.0, 4.0], [2.0, 1.0, 12.0], (200, 3))
    in_right = points @ stereo.T_right_left[:3, :3].T + stereo.T_right_left[:3, 3]
    a, b = left.camera.project(points @ left.R.T), right.camera.project(in_right @ right.R.T)
    assert a[:, 1] == pytest.approx(b[:, 1], abs=1e-9)
    depth = (points @ left.R.T)[:, 2]
    assert a[:, 0] - b[:, 0] == pytest.approx(left.camera.fx * baseline_m / depth, abs=1e-9)


def test_maps_are_computed_once_per_calibration() -> None:
    rectified_pair(wall())
    before = rectification._rectified_pair.cache_info()
    rectified_pair(wall())
    after = rectification._rectified_pair.cache_info()
    assert (after.hits, after.misses) == (before.hits + 1, before.misses)


def test_rotating_the_mast_with_both_cameras_reuses_the_rectification_maps() -> None:
    first = rectified_pair(wall())
    before = rectification._rectified_pair.cache_info()
    for pan in (0.3, 0.7, -1.1, 1.9):
        rotated = rectified_pair(
            wall(), T_base_left=se3.transform(se3.exp_so3([0, 0, pan]), [0.1, 0, 0]) @ T_BASE_LEFT
        )
        assert (rotated.left.image == first.left.image).all()
        assert rotated.baseline == first.baseline
    after = rectification._rectified_pair.cache_info()
    assert (after.hits, after.misses) == (before.hits + 4, before.misses)


def test_pairs_that_cannot_be_rectified_are_refused_with_the_reason() -> None:
    node = Rectification()
    node.configure()
    image = np.zeros((300, 400), np.uint8)
    left = frame(LEFT, image, np.eye(4))
    above = frame(RIGHT, image, se3.transform(np.eye(3), [0.0, -0.2, 0.0]))
    with pytest.raises(InputError, match="to its right"):
        node.process(StereoRectificationInputs(pair=FramePair(baseline=0.0, left=left, right=above)))
    without_extrinsic = Frame.from_image(image, stamp_ns=0, camera_matrix=RIGHT.matrix)
    with pytest.raises(InputError, match="need an extrinsic"):
        node.process(
            StereoRectificationInputs(pair=FramePair(baseline=0.0, left=left, right=without_extrinsic))
        )
    undistortion = Undistortion()
    undistortion.configure()
    with pytest.raises(InputError, match="CAM_UNDEF"):
        undistortion.process(ImageUndistortionInputs(image=Frame.from_image(image, stamp_ns=0)))
    wide = replace(FISHEYE, fx=60.0, fy=60.0)
    with pytest.raises(InputError, match="field of view is too wide"):
        undistortion.process(ImageUndistortionInputs(image=frame(wide, image, np.eye(4))))


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.lens)
def test_a_pair_of_each_lens_has_common_rows(camera: CameraModel) -> None:
    ideal_left, ideal_right, baseline_m = rectification.rectified(
        StereoCalibration(camera, camera, STEREO.T_right_left), 0.0
    )
    points = wall()
    right = points @ STEREO.T_right_left[:3, :3].T + STEREO.T_right_left[:3, 3]
    left_px = ideal_left.camera.project(points @ ideal_left.R.T)
    right_px = ideal_right.camera.project(right @ ideal_right.R.T)
    assert left_px[:, 1] == pytest.approx(right_px[:, 1], abs=1e-9)
    depths_m = (points @ ideal_left.R.T)[:, 2]
    disparities_px = ideal_left.camera.fx * baseline_m / depths_m
    assert left_px[:, 0] - right_px[:, 0] == pytest.approx(disparities_px, abs=1e-9)


@pytest.mark.parametrize(
    "camera",
    [
        CameraModel(300, 300, 95.0, 95.0, 150.0, 150.0, lens="fisheye"),
        CameraModel(300, 300, 200.0, 200.0, 150.0, 150.0, (1.1,), "omnidirectional"),
    ],
    ids=lambda camera: camera.lens,
)
def test_a_view_of_180_degrees_is_refused_unless_it_is_cropped(camera: CameraModel) -> None:
    with pytest.raises(InputError, match="max_angle_deg"):
        rectification.undistorted(camera, 0.0)
    ideal = rectification.undistorted(camera, 0.0, 60.0).camera
    corner = np.abs(ideal.rays([[0.0, 150.0], [299.0, 299.0]]))
    assert np.rad2deg(np.arccos(corner[:, 2])).max() == pytest.approx(60.0, abs=2.0)
