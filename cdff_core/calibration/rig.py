# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration of one or two rigidly connected cameras from views of a board.

All intrinsic parameters, the pose of the second camera and the pose of the board in each view are adjusted
together [1]_, with Huber's weights; the poses of the board are eliminated by the Schur complement [2]_. An
initial guess is not needed: focal lengths are tried, and the one whose board poses fit best is the start.

References
----------
.. [1] Zhang, Z. (2000). A flexible new technique for camera calibration. IEEE TPAMI 22(11).
  doi:10.1109/34.888718
.. [2] Triggs, B., et al. (2000). Bundle adjustment: a modern synthesis. doi:10.1007/3-540-44480-7_21
.. [3] Collins, T., Bartoli, A. (2014). Infinitesimal plane-based pose estimation. IJCV 109.
  doi:10.1007/s11263-014-0725-5
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.camera import CameraModel, LensName
from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_core.calibration.adjustment import (
    Rig,
    View,
    adjusted,
    corner_residuals,
    corner_sigma,
    huber_weights,
    jacobians,
    moved_pose,
    parameter_names,
    regular_inverse,
    robust_cost,
)
from cdff_core.calibration.covariance import rig_covariance

#: Coefficients with which the search of the focal length starts.
_STARTS: dict[LensName, tuple[float, ...]] = {
    "pinhole": (),
    "fisheye": (0.0, 0.0, 0.0, 0.0),
    "omnidirectional": (1.0, 0.0, 0.0, 0.0, 0.0),
    "fov": (0.7,),
    "division": (-0.05,),
}
#: Tried focal lengths, in widths of the image.
_FOCAL_WIDTHS = np.geomspace(0.2, 5.0, 24)
#: Number of views with which focal lengths are tried.
_TRIED_VIEWS = 12
#: Corners above this number of standard deviations are dropped once.
_GATE = 6.0
#: Steps that refine one pose of a board, and smallest z of a ray whose corner is used for it.
_BOARD_STEPS, _LEAST_Z = 8, 0.15
#: Least number of views.
LEAST_VIEWS = 3


@dataclass(frozen=True, slots=True, eq=False)
class RigCalibration:
    """Result of ``calibrate_rig``.

    Attributes
    ----------
    cameras : tuple of CameraModel
    T_camera_first : tuple of ndarray, shape (4, 4)
        Pose of the first camera in each camera.
    T_first_board : dict of int to ndarray, shape (4, 4)
    names : tuple of str
        Parameters of the covariance: ``0.fx`` ..., and ``1.x`` ... ``1.rz`` of ``T_camera_first``
        (translation added, rotation ``Exp(r) R``; metres, radians).
    covariance : ndarray, shape (s, s)
    residuals_px : tuple of ndarray, shape (k, 2)
        Measured minus computed, for each view.
    views : tuple of View
        Views with the corners that were used.
    sigma_px : float
        Standard deviation of a coordinate of a corner.
    dropped : int
        Corners that were dropped as outliers.
    """

    cameras: tuple[CameraModel, ...]
    T_camera_first: tuple[FloatArray, ...]
    T_first_board: dict[int, FloatArray]
    names: tuple[str, ...]
    covariance: FloatArray
    residuals_px: tuple[FloatArray, ...]
    views: tuple[View, ...]
    sigma_px: float
    dropped: int

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter, in its unit."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def rms_px(self) -> float:
        """Root mean square of the distance between measured and computed corners."""
        squares = np.concatenate([(r**2).sum(axis=1) for r in self.residuals_px])
        return float(np.sqrt(squares.mean()))


def calibrate_rig(
    views: Sequence[View], sizes: Sequence[tuple[int, int]], lens: LensName = "pinhole", coefficients: int = 5
) -> RigCalibration:
    """Return the calibration of the cameras ``0 .. len(sizes) - 1``.

    Parameters
    ----------
    views : sequence of View
        Each camera needs at least three; the second camera needs boards that the first sees too.
    sizes : sequence of (rows, cols)
        Size of the images of each camera.
    lens : str
    coefficients : int
        Number of distortion coefficients of a pinhole; the other lenses have a fixed number.

    Raises
    ------
    InputError
        If a camera has fewer than three views, or the lens does not have this number of coefficients.
    DegenerateGeometryError
        If no focal length explains the views, or the adjustment fails.
    """
    rig = _initial(views, sizes, lens, coefficients)
    views = [view for view in views if view.board in rig.boards]
    rig = adjusted(rig, views, is_free=_free(rig, with_distortion=False))
    rig = adjusted(rig, views, is_free=_free(rig, with_distortion=True))
    rig = adjusted(_with_best_boards(rig, views), views, is_free=_free(rig, with_distortion=True))
    sigma_px = corner_sigma(corner_residuals(rig, views))
    used, dropped = [], 0
    for view, r in zip(views, corner_residuals(rig, views), strict=True):
        is_kept = np.linalg.norm(r, axis=1) < _GATE * sigma_px
        dropped += int((~is_kept).sum())
        if is_kept.sum() >= 4:
            used.append(_selected(view, is_kept))
    seen = {view.board for view in used}
    rig = replace(rig, boards={k: T for k, T in rig.boards.items() if k in seen})
    rig = adjusted(rig, used, is_free=_free(rig, with_distortion=True))
    residuals = corner_residuals(rig, used)
    count, parameters = sum(2 * len(r) for r in residuals), len(parameter_names(rig)) + 6 * len(rig.boards)
    if count <= parameters:
        raise InputError(f"{count // 2} corners for {parameters} unknowns: expected more views of the board")
    assumed_px = corner_sigma(residuals)
    weighted = sum(float((huber_weights(r, assumed_px) * r**2).sum()) for r in residuals)
    sigma_px = float(np.sqrt(weighted * assumed_px**2 / (count - parameters)))
    covariance = rig_covariance(rig, used, sigma_px)
    return RigCalibration(
        rig.cameras,
        rig.poses,
        rig.boards,
        parameter_names(rig),
        covariance,
        tuple(residuals),
        tuple(used),
        sigma_px,
        dropped,
    )


def _selected(view: View, is_kept: BoolArray) -> View:
    return replace(
        view,
        corners_m=view.corners_m[is_kept],
        pixels=view.pixels[is_kept],
        numbers=view.numbers[is_kept],
    )


def _free(rig: Rig, with_distortion: bool) -> BoolArray:
    """Return which of the shared parameters are adjusted."""
    fixed: tuple[str, ...] = (
        "cx",
        "cy",
        "k1",
        "k2",
        "k3",
        "k4",
        "k5",
        "k6",
        "p1",
        "p2",
        "s1",
        "s2",
        "s3",
        "s4",
    )
    fixed += ("xi", "omega", "lambda")
    return np.array([with_distortion or name.partition(".")[2] not in fixed for name in parameter_names(rig)])


# -- start
# -----------------------------------------------------------------------------------------------------------


def _initial(
    views: Sequence[View], sizes: Sequence[tuple[int, int]], lens: LensName, coefficients: int
) -> Rig:
    """Return cameras without distortion, and the poses that fit them."""
    cameras, poses = [], [np.eye(4)]
    boards: dict[int, FloatArray] = {}
    for number, (rows, cols) in enumerate(sizes):
        own = [view for view in views if view.camera == number]
        if len(own) < LEAST_VIEWS:
            raise InputError(
                f"camera {number}: the board was detected in {len(own)} images, expected at least "
                f"{LEAST_VIEWS}; check the numbers and sizes of the board"
            )
        start = _STARTS[lens] if lens != "pinhole" else (0.0,) * coefficients
        tried = own[:: max(1, len(own) // _TRIED_VIEWS)]
        options = []
        for focal in _FOCAL_WIDTHS * cols:
            camera = CameraModel(
                rows, cols, float(focal), float(focal), (cols - 1) / 2, (rows - 1) / 2, start, lens
            )
            errors = [error for view in tried if (error := _board_pose(camera, view)[1]) is not None]
            options.append((float(np.median(errors)) if len(errors) * 2 > len(tried) else np.inf, camera))
        error, camera = min(options, key=lambda option: option[0])
        if not np.isfinite(error):
            raise DegenerateGeometryError(
                f"camera {number}: no focal length explains the board in {len(own)} images; check its size "
                "and kind"
            )
        cameras.append(camera)
        own_boards = {view.board: T for view in own if (T := _board_pose(camera, view)[0]) is not None}
        if number == 0:
            boards = own_boards
            continue
        common = [T @ se3.inverse(boards[k]) for k, T in own_boards.items() if k in boards]
        if not common:
            raise InputError(
                f"camera {number} has no view of a board that camera 0 sees: expected common views"
            )
        poses.append(_median_pose(common))
        boards = {k: se3.inverse(poses[-1]) @ T for k, T in own_boards.items()} | boards
    return Rig(tuple(cameras), tuple(poses), boards)


def _median_pose(poses: Sequence[FloatArray]) -> FloatArray:
    """Return the pose with the smallest sum of rotation angles to the others."""
    R = np.array([T[:3, :3] for T in poses])
    angles = se3.rotation_angle(np.einsum("aij,bkj->abik", R, R).reshape(-1, 3, 3)).reshape(len(R), -1)
    return poses[int(angles.sum(axis=1).argmin())]


def _with_best_boards(rig: Rig, views: Sequence[View]) -> Rig:
    """Return the rig with the better of the two poses that a view of a plane permits [3]_, for each board."""
    sigma_px = corner_sigma(corner_residuals(rig, views))
    boards = {}
    for board, current in rig.boards.items():
        own = [view for view in views if view.board == board]
        options = [current]
        for view in own:
            P = se3.inverse(rig.poses[view.camera])
            options += [P @ T for T in plane_poses(rig.cameras[view.camera], view)]
        refined = [refined_board(rig, own, board, T, sigma_px) for T in options]
        boards[board] = min(refined, key=lambda pair: pair[0])[1]
    return replace(rig, boards=boards)


def refined_board(
    rig: Rig, views: Sequence[View], board: int, T: FloatArray, sigma_px: float
) -> tuple[float, FloatArray]:
    """Return the cost and the pose of a board after Gauss-Newton steps with known cameras."""
    trial = replace(rig, boards={board: T})
    for _ in range(_BOARD_STEPS):
        H, g = np.zeros((6, 6)), np.zeros(6)
        for view, r in zip(views, corner_residuals(trial, views), strict=True):
            J = jacobians(trial, view)[1]
            w = huber_weights(r, sigma_px).repeat(2, axis=1).reshape(-1)
            H += J.T @ (J * w[:, None])
            g += J.T @ (w * r.reshape(-1))
        trial = replace(trial, boards={board: moved_pose(trial.boards[board], regular_inverse(H) @ g)})
    return robust_cost(trial, views, sigma_px), trial.boards[board]


def plane_poses(camera: CameraModel, view: View) -> list[FloatArray]:
    """Return both poses T_camera_board that a view of a plane permits [3]_."""
    rays = camera.rays(view.pixels)
    is_usable = np.isfinite(rays).all(axis=1) & (rays[:, 2] > _LEAST_Z)
    if is_usable.sum() < 6:
        return []
    plane = rays[is_usable, :2] / rays[is_usable, 2:]
    try:
        _, rvecs, tvecs, _ = cv2.solvePnPGeneric(
            view.corners_m[is_usable], plane, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return []
    return [
        se3.transform(se3.exp_so3(np.ravel(rvec)), np.ravel(tvec))
        for rvec, tvec in zip(rvecs, tvecs, strict=True)
        if np.isfinite(rvec).all() and np.isfinite(tvec).all()
    ]


def _board_pose(camera: CameraModel, view: View) -> tuple[FloatArray | None, float | None]:
    """Return T_camera_board and the median error in pixels; None if it has no pose."""
    poses = plane_poses(camera, view)
    if not poses:
        return None, None
    T = poses[0]
    pixels = camera.project(view.corners_m @ T[:3, :3].T + T[:3, 3])
    error = float(np.median(np.abs(pixels - view.pixels)))
    return (T, error) if np.isfinite(error) else (None, None)


# -- adjustment
# -----------------------------------------------------------------------------------------------------------
