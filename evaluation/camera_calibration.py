# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate ``cdff calibrate camera`` and ``stereo`` on rendered boards with known cameras, next to OpenCV.

Both calibrations receive the same corners, which the commands detect. The error of a camera is the RMS
distance, over a grid of the image, between a pixel and the projection by the true camera of the ray that the
estimated camera has for this pixel, after the best rotation, since the orientation of the camera frame is not
observable. It is also stated for the grid points inside the convex hull of the corners, where nothing is
extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import Delaunay

from cdff_common.arrays import BoolArray
from cdff_common.camera import CameraModel
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.calibration.adjustment import View
from cdff_core.calibration.assessment import judged
from cdff_core.calibration.boards import Board
from cdff_core.calibration.rig import RigCalibration, calibrate_rig
from cdff_dev.simulate.board_images import board_image, board_poses

BOARDS = {
    "charuco": Board("charuco", 9, 7, 0.03, 0.022),
    "chessboard": Board("chessboard", 9, 6, 0.03),
    "aprilgrid": Board("aprilgrid", 6, 5, 0.035, 0.3),
}
CAMERAS = {
    "pinhole": CameraModel(480, 640, 520.0, 523.0, 315.0, 243.0, (-0.25, 0.08, 5e-4, -3e-4, 0.01)),
    "fisheye": CameraModel(480, 640, 230.0, 231.0, 318.0, 242.0, (-0.01, 0.02, -0.003, 0.0005), "fisheye"),
    "omnidirectional": CameraModel(
        480, 640, 560.0, 562.0, 318.0, 242.0, (1.2, -0.1, 0.02, 1e-4, -2e-4), "omnidirectional"
    ),
    "fov": CameraModel(480, 640, 330.0, 331.0, 318.0, 242.0, (0.9,), "fov"),
    "division": CameraModel(480, 640, 400.0, 401.0, 318.0, 242.0, (-0.2,), "division"),
}
#: Distance of the board, metres, for each lens.
DISTANCES_M = {"pinhole": 0.36, "fisheye": 0.2, "omnidirectional": 0.2, "fov": 0.24, "division": 0.28}
RIGHT = CameraModel(480, 640, 518.0, 521.0, 322.0, 238.0, (-0.24, 0.07, -5e-4, 3e-4, 0.01))
T_RIGHT_LEFT = se3.transform(se3.exp_so3([0.01, -0.02, 0.005]), [-0.12, 0.001, 0.002])
SEEDS = range(100, 106)
IMAGES = 14
_GRID = 33


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors for each lens and board, of stereo pairs, and of images that determine too little."""
    figures: dict[str, Any] = {"seeds": len(SEEDS), "images": IMAGES, "cameras": {}}
    cases = [("pinhole", name) for name in BOARDS] + [
        (lens, "charuco") for lens in CAMERAS if lens != "pinhole"
    ]
    for lens, name in cases:
        progress(f"camera calibration: {lens}, {name}")
        figures["cameras"][f"{lens}, {name}"] = _camera_figures(lens, BOARDS[name])
    progress("camera calibration: stereo")
    figures["stereo"] = _stereo_figures(BOARDS["charuco"])
    progress("camera calibration: assessments")
    figures["assessments"] = _assessments(BOARDS["charuco"])
    return figures


def camera_views(
    camera: CameraModel, board: Board, seed: int, *, images: int = IMAGES, tilt_deg: float = 35.0
) -> list[View]:
    """Return the detected corners of rendered images."""
    rng = np.random.default_rng(seed)
    views = []
    poses = board_poses(board, images, rng, distance_m=DISTANCES_M[camera.lens], tilt_deg=tilt_deg)
    for k, T in enumerate(poses):
        numbers, pixels = board.detect(board_image(camera, board, T, rng))
        if len(numbers):
            views.append(View(0, k, board.corners_m[numbers], pixels, numbers))
    return views


def _camera_figures(lens: str, board: Board) -> dict[str, Any]:
    camera = CAMERAS[lens]
    rows, peers, nees, ratios = [], [], [], []
    for seed in SEEDS:
        views = camera_views(camera, board, seed)
        result = calibrate_rig(views, [(camera.rows, camera.cols)], camera.lens)
        error = _parameter_errors(result, 0, camera)
        nees.append(float(error @ np.linalg.pinv(result.covariance) @ error) / len(error))
        ratios.append(np.abs(error) / np.sqrt(np.diag(result.covariance)))
        grid, is_covered = _grid(views, camera)
        rows.append(
            [
                _mapping_error(result.cameras[0], camera, grid),
                result.rms_px,
                len(views),
                result.dropped,
                _mapping_error(result.cameras[0], camera, grid[is_covered]),
                is_covered.mean(),
                judged(result).is_good,
            ]
        )
        if (peer := _opencv(views, camera)) is not None:
            peers.append([_mapping_error(peer, camera, pixels) for pixels in (grid, grid[is_covered])])
    mean = np.mean(rows, axis=0)
    peer_mean = [round(float(v), 4) for v in np.mean(peers, axis=0)] if peers else [None, None]
    return {
        "error_px": round(float(mean[0]), 4),
        "covered_error_px": round(float(mean[4]), 4),
        "covered_part": round(float(mean[5]), 2),
        "assessed_good": round(float(mean[6]), 2),
        "opencv_error_px": peer_mean[0],
        "opencv_covered_error_px": peer_mean[1],
        "rms_px": round(float(mean[1]), 4),
        "views": round(float(mean[2]), 1),
        "dropped": round(float(mean[3]), 1),
        "nees": round(float(np.mean(nees)), 2),
        "within_3_sigma": round(float((np.concatenate(ratios) < 3.0).mean()), 3),
    }


def _parameter_errors(result: RigCalibration, number: int, truth: CameraModel) -> FloatArray:
    camera = result.cameras[number]
    estimate = np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])
    return estimate - np.array([truth.fx, truth.fy, truth.cx, truth.cy, *truth.distortion])


def _grid(views: list[View], camera: CameraModel) -> tuple[FloatArray, BoolArray]:
    """Return pixels ``(n, 2)`` over the image, and which are inside the convex hull of the corners."""
    x, y = np.meshgrid(np.linspace(0, camera.cols - 1, _GRID), np.linspace(0, camera.rows - 1, _GRID))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    hull = Delaunay(np.vstack([view.pixels for view in views]))
    return pixels, hull.find_simplex(pixels) >= 0


def _mapping_error(estimate: CameraModel, truth: CameraModel, pixels: FloatArray) -> float:
    """Return the RMS distance of projections of ``pixels`` (n, 2) from them, pixels."""
    a, b = estimate.rays(pixels), truth.rays(pixels)
    is_seen = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    U, _, Vt = np.linalg.svd(b[is_seen].T @ a[is_seen])
    difference = truth.project(a[is_seen] @ (U @ Vt).T) - pixels[is_seen]
    return float(np.sqrt((difference**2).sum(axis=1).mean()))


def _opencv(views: list[View], truth: CameraModel) -> CameraModel | None:
    """Return the calibration by OpenCV; None if it has no such lens."""
    size = (truth.cols, truth.rows)
    corners = [v.corners_m.astype(np.float32)[:, None] for v in views]
    pixels = [v.pixels.astype(np.float32)[:, None] for v in views]
    if truth.lens == "pinhole":
        _, K, D, _, _ = cv2.calibrateCamera(corners, pixels, size, None, None)
    elif truth.lens == "fisheye":
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
        rows = ([array.reshape(1, len(array), -1) for array in arrays] for arrays in (corners, pixels))
        _, K, D, _, _ = cv2.fisheye.calibrate(*rows, size, None, None, flags=flags)
    else:
        return None
    return CameraModel.from_matrix(K, D, rows=truth.rows, cols=truth.cols, lens=truth.lens)


def _stereo_figures(board: Board) -> dict[str, Any]:
    left = CAMERAS["pinhole"]
    errors, sigmas, peers, z = [], [], [], []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        views = []
        for k, T in enumerate(board_poses(board, IMAGES, rng, distance_m=0.4)):
            for number, (camera, pose) in enumerate(((left, T), (RIGHT, T_RIGHT_LEFT @ T))):
                numbers, pixels = board.detect(board_image(camera, board, pose, rng))
                if len(numbers):
                    views.append(View(number, k, board.corners_m[numbers], pixels, numbers))
        result = calibrate_rig(views, [(left.rows, left.cols)] * 2, "pinhole")
        estimate = result.T_camera_first[1]
        error = _pose_error(estimate)
        rows = [result.names.index(f"1.{n}") for n in ("x", "y", "z", "rx", "ry", "rz")]
        covariance = result.covariance[np.ix_(rows, rows)]
        z.append(float(error @ np.linalg.pinv(covariance) @ error) / 6.0)
        errors.append(error)
        sigmas.append(np.sqrt(np.diag(covariance)))
        peers.append(_pose_error(_opencv_stereo(views, left)))

    def summary(values: list[FloatArray]) -> dict[str, float]:
        squares = np.mean(np.square(values), axis=0)
        return {
            "mm": round(float(np.sqrt(squares[:3].sum())) * 1e3, 4),
            "deg": round(float(np.rad2deg(np.sqrt(squares[3:].sum()))), 5),
        }

    return {
        "error": summary(errors),
        "sigma": summary(sigmas),
        "opencv": summary(peers),
        "nees": round(float(np.mean(z)), 2),
    }


def _pose_error(T: FloatArray) -> FloatArray:
    rotation = se3.log_so3(T[:3, :3] @ T_RIGHT_LEFT[:3, :3].T)
    return np.concatenate([T[:3, 3] - T_RIGHT_LEFT[:3, 3], rotation])


def _opencv_stereo(views: list[View], left: CameraModel) -> FloatArray:
    """Return T_right_left by OpenCV: each camera alone, then all parameters together."""
    size = (left.cols, left.rows)
    by_board: dict[int, dict[int, View]] = {}
    for view in views:
        by_board.setdefault(view.board, {})[view.camera] = view
    corners, pixels = [], ([], [])
    for pair in by_board.values():
        if len(pair) < 2:
            continue
        numbers, a, b = np.intersect1d(pair[0].numbers, pair[1].numbers, return_indices=True)
        if len(numbers) >= 6:
            corners.append(pair[0].corners_m[a].astype(np.float32)[:, None])
            pixels[0].append(pair[0].pixels[a].astype(np.float32)[:, None])
            pixels[1].append(pair[1].pixels[b].astype(np.float32)[:, None])
    start = []
    for number in (0, 1):
        own = [v for v in views if v.camera == number]
        c = [v.corners_m.astype(np.float32)[:, None] for v in own]
        p = [v.pixels.astype(np.float32)[:, None] for v in own]
        start.append(cv2.calibrateCamera(c, p, size, None, None)[1:3])
    (K1, D1), (K2, D2) = start
    result = cv2.stereoCalibrate(corners, *pixels, K1, D1, K2, D2, size, flags=cv2.CALIB_USE_INTRINSIC_GUESS)
    return se3.transform(np.asarray(result[5]), np.asarray(result[6]).ravel())


def _assessments(board: Board) -> dict[str, list[str]]:
    """Return the sentences for images that determine the camera badly."""
    camera = CAMERAS["pinhole"]
    size = [(camera.rows, camera.cols)]
    cases = {
        f"{IMAGES} images, tilts up to 35°": camera_views(camera, board, 200),
        f"{IMAGES} images, tilts up to 3°": camera_views(camera, board, 201, tilt_deg=3.0),
        "4 images": camera_views(camera, board, 202, images=4),
    }
    left_half = [v for v in next(iter(cases.values())) if v.pixels[:, 0].max() < camera.cols * 0.7]
    if len(left_half) >= 3:
        cases["board on the left only"] = left_half
    return {name: list(judged(calibrate_rig(views, size)).sentences) for name, views in cases.items()}


def table(figures: dict[str, Any]) -> str:
    """Return the tables."""
    lines = [
        "| lens, board | images with the board | residuals (RMS) | covered part of the image | error in it | "
        "of OpenCV | error over the image | of OpenCV | NEES per parameter (1 expected) | "
        "parameters within 3 σ | assessed as good |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in figures["cameras"].items():
        covered, whole = (
            "–" if row[key] is None else f"{row[key]:.3f} px"
            for key in ("opencv_covered_error_px", "opencv_error_px")
        )
        lines.append(
            f"| {name} | {row['views']} of {figures['images']} | {row['rms_px']:.3f} px "
            f"| {100 * row['covered_part']:.0f} % | {row['covered_error_px']:.3f} px | {covered} "
            f"| {row['error_px']:.3f} px | {whole} | {row['nees']:.2f} | {100 * row['within_3_sigma']:.0f} % "
            f"| {100 * row['assessed_good']:.0f} % |"
        )
    s = figures["stereo"]
    lines += [
        "",
        "| stereo pair, 12 cm | translation | rotation |",
        "|---|---|---|",
        f"| error | {s['error']['mm']:.3f} mm | {s['error']['deg']:.4f}° |",
        f"| stated σ | {s['sigma']['mm']:.3f} mm | {s['sigma']['deg']:.4f}° |",
        f"| error of OpenCV | {s['opencv']['mm']:.3f} mm | {s['opencv']['deg']:.4f}° |",
        "",
        f"NEES of the relative pose per parameter: {s['nees']:.2f} (1 expected).",
        "",
        "| images | assessment |",
        "|---|---|",
    ]
    lines += [f"| {name} | {'; '.join(sentences)} |" for name, sentences in figures["assessments"].items()]
    return "\n".join(lines)
