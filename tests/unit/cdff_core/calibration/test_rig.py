# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration of cameras from views of a board: true parameters within stated errors, and the assessment."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.calibration.adjustment import View
from cdff_core.calibration.assessment import judged
from cdff_core.calibration.boards import Board, BoardKind
from cdff_core.calibration.rig import calibrate_rig
from cdff_dev.simulate.board_images import board_image, board_poses

BOARD = Board("chessboard", 9, 7, 0.03)
CAMERAS = [
    CameraModel(480, 640, 520.0, 523.0, 315.0, 243.0, (-0.25, 0.08, 5e-4, -3e-4, 0.01)),
    CameraModel(480, 640, 230.0, 231.0, 318.0, 242.0, (-0.01, 0.02, -0.003, 0.0005), "fisheye"),
    CameraModel(480, 640, 560.0, 562.0, 318.0, 242.0, (1.2, -0.1, 0.02, 1e-4, -2e-4), "omnidirectional"),
    CameraModel(480, 640, 330.0, 331.0, 318.0, 242.0, (0.9,), "fov"),
    CameraModel(480, 640, 400.0, 401.0, 318.0, 242.0, (-0.2,), "division"),
]
DISTANCES_M = {"pinhole": 0.4, "fisheye": 0.2, "omnidirectional": 0.2, "fov": 0.25, "division": 0.3}
T_RIGHT_LEFT = se3.transform(se3.exp_so3([0.01, -0.02, 0.005]), [-0.12, 0.001, 0.002])


def exact_views(
    camera: CameraModel,
    rng: np.random.Generator,
    *,
    count: int = 15,
    tilt_deg: float = 35.0,
    noise_px: float = 0.1,
    number: int = 0,
    T: np.ndarray | None = None,
    seed: int = 3,
) -> list[View]:
    """Return projected corners with noise; the poses depend on the seed only."""
    distance_m = DISTANCES_M[camera.lens]
    views = []
    for k, pose in enumerate(
        board_poses(BOARD, count, np.random.default_rng(seed), distance_m=distance_m, tilt_deg=tilt_deg)
    ):
        T_camera_board = pose if T is None else T @ pose
        pixels = camera.project(BOARD.corners_m @ T_camera_board[:3, :3].T + T_camera_board[:3, 3])
        pixels = pixels + rng.normal(0.0, noise_px, pixels.shape)
        inside = ((pixels > 0) & (pixels < [camera.cols - 1, camera.rows - 1])).all(axis=1)
        numbers = np.flatnonzero(inside)
        if len(numbers) >= 8:
            views.append(View(number, k, BOARD.corners_m[numbers], pixels[numbers], numbers))
    return views


def parameters(camera: CameraModel) -> np.ndarray:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.lens)
def test_every_lens_is_found_without_a_guess_and_within_its_stated_errors(
    rng: np.random.Generator, camera: CameraModel
) -> None:
    result = calibrate_rig(exact_views(camera, rng), [(480, 640)], camera.lens)
    error = parameters(result.cameras[0]) - parameters(camera)
    nees = error @ np.linalg.pinv(result.covariance) @ error / len(error)
    assert nees < 4.0
    assert result.rms_px == pytest.approx(0.1 * np.sqrt(2.0), rel=0.15)
    assert result.sigma_px == pytest.approx(0.1, rel=0.15)
    assert result.names[0] == "0.fx"
    assert abs(error[0]) < 4.0 * result.sigma["0.fx"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_the_errors_of_an_omnidirectional_lens_are_within_those_stated_although_xi_is_not_observable(
    seed: int,
) -> None:
    camera = CAMERAS[2]
    result = calibrate_rig(exact_views(camera, np.random.default_rng(seed)), [(480, 640)], camera.lens)
    error = parameters(result.cameras[0]) - parameters(camera)
    assert error @ np.linalg.pinv(result.covariance) @ error / len(error) < 4.0
    assessment = judged(result)
    assert "0.xi" in assessment.unobservable
    # The focal length near the axis is well determined.
    assert "focal length" not in " ".join(assessment.sentences)


def test_wrong_corners_are_dropped(rng: np.random.Generator) -> None:
    views = exact_views(CAMERAS[0], rng)
    for view in views[:5]:
        view.pixels[3] += [7.0, -4.0]
    result = calibrate_rig(views, [(480, 640)])
    assert result.dropped >= 5
    assert result.cameras[0].fx == pytest.approx(520.0, abs=4.0 * result.sigma["0.fx"])


@pytest.mark.slow
def test_the_pose_of_the_second_camera_is_within_its_stated_errors(rng: np.random.Generator) -> None:
    right = CameraModel(480, 640, 518.0, 521.0, 322.0, 238.0, (-0.24, 0.07, -5e-4, 3e-4, 0.01))
    views = exact_views(CAMERAS[0], rng) + exact_views(right, rng, number=1, T=T_RIGHT_LEFT)
    result = calibrate_rig(views, [(480, 640)] * 2)
    T = result.T_camera_first[1]
    error = np.concatenate([T[:3, 3] - T_RIGHT_LEFT[:3, 3], se3.log_so3(T[:3, :3] @ T_RIGHT_LEFT[:3, :3].T)])
    rows = [result.names.index(f"1.{name}") for name in ("x", "y", "z", "rx", "ry", "rz")]
    assert error @ np.linalg.pinv(result.covariance[np.ix_(rows, rows)]) @ error / 6.0 < 4.0
    assert np.abs(error[:3]).max() < 1e-3


@pytest.mark.slow
def test_the_assessment_names_what_is_missing(rng: np.random.Generator) -> None:
    size = [(480, 640)]
    flat = judged(calibrate_rig(exact_views(CAMERAS[0], rng, tilt_deg=2.0), size))
    assert not flat.is_good
    assert "tilt the board more" in " ".join(flat.sentences)
    few = judged(calibrate_rig(exact_views(CAMERAS[0], rng, count=5), size))
    assert "take at least 10" in " ".join(few.sentences)
    good = judged(calibrate_rig(exact_views(CAMERAS[0], rng, count=25, noise_px=0.02), size))
    assert not good.unobservable
    assert "tilt" not in " ".join(good.sentences)


@pytest.mark.slow
def test_a_coefficient_that_the_images_do_not_determine_is_named(rng: np.random.Generator) -> None:
    views = []
    for view in exact_views(CAMERAS[0], rng, count=30, noise_px=0.3):
        is_central = np.abs(view.pixels - [320.0, 240.0]).max(axis=1) < 110
        if is_central.sum() >= 12:
            numbers = view.numbers[is_central]
            views.append(View(0, view.board, view.corners_m[is_central], view.pixels[is_central], numbers))
    assessment = judged(calibrate_rig(views, [(480, 640)]))
    assert "0.k3" in assessment.unobservable
    assert "k3" in " ".join(assessment.sentences)


def test_too_few_views_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="2 images, expected at least 3"):
        calibrate_rig(exact_views(CAMERAS[0], rng)[:2], [(480, 640)])
    alone = exact_views(CAMERAS[0], rng)
    other = [View(1, v.board + 100, v.corners_m, v.pixels, v.numbers) for v in alone]
    with pytest.raises(InputError, match="no view of a board that camera 0 sees"):
        calibrate_rig(alone + other, [(480, 640)] * 2)


@pytest.mark.parametrize(
    "board",
    [
        Board("charuco", 7, 5, 0.04, 0.03),
        Board("chessboard", 8, 5, 0.035),
        Board("aprilgrid", 5, 4, 0.04, 0.3),
    ],
    ids=lambda board: board.kind,
)
def test_the_corners_of_a_rendered_board_are_detected(board: Board, rng: np.random.Generator) -> None:
    camera = CAMERAS[0]
    T = next(board_poses(board, 1, np.random.default_rng(5), distance_m=0.5, tilt_deg=20.0))
    numbers, pixels = board.detect(board_image(camera, board, T, rng))
    assert len(numbers) >= 0.7 * len(board.corners_m)
    truth = camera.project(board.corners_m[numbers] @ T[:3, :3].T + T[:3, 3])
    # A chessboard looks the same after half a turn.
    errors = [np.median(np.linalg.norm(pixels - points, axis=1)) for points in (truth, truth[::-1])]
    assert min(errors if board.kind == "chessboard" else errors[:1]) < 0.15
    assert board.detect(np.full((480, 640), 90, np.uint8))[0].size == 0


@pytest.mark.parametrize("camera", CAMERAS[:2], ids=lambda camera: camera.lens)
def test_the_corners_of_a_chessboard_have_no_common_error(
    camera: CameraModel, rng: np.random.Generator
) -> None:
    board = Board("chessboard", 9, 6, 0.03)
    errors = []
    for T in board_poses(board, 4, np.random.default_rng(5), distance_m=DISTANCES_M[camera.lens]):
        numbers, pixels = board.detect(board_image(camera, board, T, rng))
        truth = camera.project(board.corners_m @ T[:3, :3].T + T[:3, 3])
        options = [pixels - points for points in (truth, truth[::-1]) if len(numbers)]
        errors += sorted(options, key=lambda e: float(np.abs(e).mean()))[:1]
    assert len(errors) >= 3
    assert np.abs([error.mean(axis=0) for error in errors]).max() < 0.03
    assert np.concatenate(errors).std() < 0.06


def test_the_corners_of_tags_on_white_ground_are_detected(rng: np.random.Generator) -> None:
    board, camera = Board("tags", 5, 4, 0.04, 0.3), CAMERAS[0]
    T = next(board_poses(board, 1, np.random.default_rng(5), distance_m=0.5, tilt_deg=20.0))
    numbers, pixels = board.detect(board_image(camera, board, T, rng))
    assert len(numbers) >= 0.7 * len(board.corners_m)
    truth = camera.project(board.corners_m[numbers] @ T[:3, :3].T + T[:3, 3])
    assert np.median(np.linalg.norm(pixels - truth, axis=1)) < 0.25


@pytest.mark.parametrize("kind", ["aprilgrid", "tags"])
def test_turned_tags_are_recognised(kind: BoardKind) -> None:
    board = Board(kind, 3, 3, 0.05, 0.3)
    picture = cv2.copyMakeBorder(board.picture(2000.0), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    numbers, pixels = board.detect(picture)
    expected = (board.corners_m[numbers, :2] + board.border_m) * 2000.0 + 59.5
    assert np.abs(pixels - expected).max() < 0.6


@pytest.mark.parametrize(
    ("board", "reason"),
    [
        (("chessboard", 1, 6, 0.03), "2 to 60"),
        (("charuco", 7, 5, 0.03, 0.04), "less than"),
        (("aprilgrid", 6, 6, 0.03, 0.0), "spacing"),
        (("charuco", 7, 5, 0.03, 0.02, "DICT_9"), "dictionary"),
    ],
)
def test_an_invalid_board_is_refused(board: tuple, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        Board(*board)
