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

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.camera import CameraModel, LensName
from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3

#: Names of the intrinsic parameters of each lens.
COEFFICIENT_NAMES: dict[LensName, tuple[str, ...]] = {
    "pinhole": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "fisheye": ("k1", "k2", "k3", "k4"),
    "omnidirectional": ("xi", "k1", "k2", "p1", "p2"),
    "fov": ("omega",),
    "division": ("lambda",),
}
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
_HUBER = 1.5
#: Smallest assumed standard deviation of a corner, pixels, so that exact corners stay regular.
_FLOOR_PX = 1e-3
#: Corners above this number of standard deviations are dropped once.
_GATE = 6.0
_ITERATIONS = 60
#: Steps that refine one pose of a board, and smallest z of a ray whose corner is used for it.
_BOARD_STEPS, _LEAST_Z = 8, 0.15
#: Smallest eigenvalue of normal equations with unit diagonal, relative to the largest.
_LEAST_EIGENVALUE = 1e-13
#: Least number of views.
LEAST_VIEWS = 3
Pair = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Corners of one board in one image.

    Attributes
    ----------
    camera, board : int
        Number of the camera, and of the pose of the board (equal for images of the same time).
    corners_m : ndarray, shape (k, 3)
        Corners in the frame of the board.
    pixels : ndarray, shape (k, 2)
    numbers : ndarray, shape (k,)
    """

    camera: int
    board: int
    corners_m: FloatArray
    pixels: FloatArray
    numbers: IntArray


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
    rig = _adjust(rig, views, is_free=_free(rig, with_distortion=False))
    rig = _adjust(rig, views, is_free=_free(rig, with_distortion=True))
    rig = _adjust(_with_best_boards(rig, views), views, is_free=_free(rig, with_distortion=True))
    sigma_px = _scale(_residuals(rig, views))
    used, dropped = [], 0
    for view, r in zip(views, _residuals(rig, views), strict=True):
        is_kept = np.linalg.norm(r, axis=1) < _GATE * sigma_px
        dropped += int((~is_kept).sum())
        if is_kept.sum() >= 4:
            used.append(_selected(view, is_kept))
    seen = {view.board for view in used}
    rig = replace(rig, boards={k: T for k, T in rig.boards.items() if k in seen})
    rig = _adjust(rig, used, is_free=_free(rig, with_distortion=True))
    residuals = _residuals(rig, used)
    weights_px = _scale(residuals)
    normal, _, _, _, _ = _normal_equations(rig, used, weights_px)
    parameters = len(_names(rig)) + 6 * len(rig.boards)
    count = sum(2 * len(r) for r in residuals)
    if count <= parameters:
        raise InputError(f"{count // 2} corners for {parameters} unknowns: expected more views of the board")
    weighted = sum(float((_weights(r, weights_px) * r**2).sum()) for r in residuals)
    sigma_px = float(np.sqrt(weighted * weights_px**2 / (count - parameters)))
    independent = _inverse(normal) * (sigma_px / weights_px) ** 2
    covariance = _enlarged(independent, _board_scores(rig, used, sigma_px))
    return RigCalibration(
        rig.cameras,
        rig.poses,
        rig.boards,
        _names(rig),
        covariance,
        tuple(residuals),
        tuple(used),
        sigma_px,
        dropped,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Rig:
    """Estimate: cameras, their poses T_camera_first, and the poses T_first_board by board."""

    cameras: tuple[CameraModel, ...]
    poses: tuple[FloatArray, ...]
    boards: dict[int, FloatArray]


def _selected(view: View, is_kept: BoolArray) -> View:
    return replace(
        view,
        corners_m=view.corners_m[is_kept],
        pixels=view.pixels[is_kept],
        numbers=view.numbers[is_kept],
    )


def _names(rig: _Rig) -> tuple[str, ...]:
    names = []
    for number, camera in enumerate(rig.cameras):
        coefficients = COEFFICIENT_NAMES[camera.lens][: len(camera.distortion)]
        names += [f"{number}.{name}" for name in ("fx", "fy", "cx", "cy", *coefficients)]
        if number:
            names += [f"{number}.{name}" for name in ("x", "y", "z", "rx", "ry", "rz")]
    return tuple(names)


def _free(rig: _Rig, with_distortion: bool) -> BoolArray:
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
    return np.array([with_distortion or name.partition(".")[2] not in fixed for name in _names(rig)])


def _board_scores(rig: _Rig, views: Sequence[View], sigma_px: float) -> FloatArray:
    """Return the gradient of the shared parameters for each pose of the board, ``(boards, shared)``."""
    scores = []
    for board in rig.boards:
        own_views = [view for view in views if view.board == board]
        single = replace(rig, boards={board: rig.boards[board]})
        scores.append(_normal_equations(single, own_views, sigma_px)[1])
    return np.array(scores)


def _enlarged(independent: FloatArray, scores: FloatArray) -> FloatArray:
    """Return the covariance of independent corners, enlarged where errors are correlated within a view.

    The enlarged covariance is the sandwich estimate with a cluster for each pose of the board.
    """
    count = len(scores)
    clustered = independent @ (scores.T @ scores) @ independent * (count / max(count - 1, 1))
    ratios = np.diag(clustered) / np.maximum(np.diag(independent), 1e-300)
    factors = np.sqrt(np.maximum(ratios, 1.0))
    return np.asarray(independent * np.outer(factors, factors))


# -- start
# -----------------------------------------------------------------------------------------------------------


def _initial(
    views: Sequence[View], sizes: Sequence[tuple[int, int]], lens: LensName, coefficients: int
) -> _Rig:
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
    return _Rig(tuple(cameras), tuple(poses), boards)


def _median_pose(poses: Sequence[FloatArray]) -> FloatArray:
    """Return the pose with the smallest sum of rotation angles to the others."""
    R = np.array([T[:3, :3] for T in poses])
    angles = se3.rotation_angle(np.einsum("aij,bkj->abik", R, R).reshape(-1, 3, 3)).reshape(len(R), -1)
    return poses[int(angles.sum(axis=1).argmin())]


def _with_best_boards(rig: _Rig, views: Sequence[View]) -> _Rig:
    """Return the rig with the better of the two poses that a view of a plane permits [3]_, for each board."""
    sigma_px = _scale(_residuals(rig, views))
    boards = {}
    for board, current in rig.boards.items():
        own = [view for view in views if view.board == board]
        options = [current]
        for view in own:
            P = se3.inverse(rig.poses[view.camera])
            options += [P @ T for T in _plane_poses(rig.cameras[view.camera], view)]
        refined = [_refined_board(rig, own, board, T, sigma_px) for T in options]
        boards[board] = min(refined, key=lambda pair: pair[0])[1]
    return replace(rig, boards=boards)


def _refined_board(
    rig: _Rig, views: Sequence[View], board: int, T: FloatArray, sigma_px: float
) -> tuple[float, FloatArray]:
    """Return the cost and the pose of a board after Gauss-Newton steps with known cameras."""
    trial = replace(rig, boards={board: T})
    for _ in range(_BOARD_STEPS):
        H, g = np.zeros((6, 6)), np.zeros(6)
        for view, r in zip(views, _residuals(trial, views), strict=True):
            J = _jacobians(trial, view)[1]
            w = _weights(r, sigma_px).repeat(2, axis=1).reshape(-1)
            H += J.T @ (J * w[:, None])
            g += J.T @ (w * r.reshape(-1))
        trial = replace(trial, boards={board: _turned(trial.boards[board], _inverse(H) @ g)})
    return _cost(trial, views, sigma_px), trial.boards[board]


def _plane_poses(camera: CameraModel, view: View) -> list[FloatArray]:
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
    poses = _plane_poses(camera, view)
    if not poses:
        return None, None
    T = poses[0]
    pixels = camera.project(view.corners_m @ T[:3, :3].T + T[:3, 3])
    error = float(np.median(np.abs(pixels - view.pixels)))
    return (T, error) if np.isfinite(error) else (None, None)


# -- adjustment
# -----------------------------------------------------------------------------------------------------------


def _adjust(rig: _Rig, views: Sequence[View], is_free: BoolArray) -> _Rig:
    """Return the rig with the least robust cost, by Levenberg-Marquardt."""
    damping = 1e-3
    sigma_px = _scale(_residuals(rig, views))
    cost = _cost(rig, views, sigma_px)
    for _ in range(_ITERATIONS):
        S, g, inverses, crosses, own = _normal_equations(rig, views, sigma_px, damping)
        improved = False
        while damping < 1e9:
            damped = S[np.ix_(is_free, is_free)] + damping * np.diag(np.diag(S)[is_free])
            step = np.zeros(len(g))
            step[is_free] = _inverse(damped) @ g[is_free]
            boards = {k: inverses[k] @ (own[k] - crosses[k].T @ step) for k in rig.boards}
            trial = _moved(rig, step, boards)
            trial_cost = np.inf if trial is None else _cost(trial, views, sigma_px)
            if trial is not None and trial_cost < cost:
                improved = True
                break
            damping *= 8.0
            S, g, inverses, crosses, own = _normal_equations(rig, views, sigma_px, damping)
        if not improved or trial is None:
            break
        change = (cost - trial_cost) / max(cost, 1e-12)
        rig, damping = trial, max(damping / 8.0, 1e-9)
        sigma_px = _scale(_residuals(rig, views))
        cost = _cost(rig, views, sigma_px)
        if change < 1e-9:
            break
    if not np.isfinite(cost):
        raise DegenerateGeometryError(
            "the adjustment of the cameras does not converge; take other views of the board"
        )
    return rig


def _moved(rig: _Rig, step: FloatArray, boards: dict[int, FloatArray]) -> _Rig | None:
    """Return the rig after a step; None if a camera would be invalid."""
    cameras, poses, at = [], [rig.poses[0]], 0
    for number, camera in enumerate(rig.cameras):
        count = 4 + len(camera.distortion)
        moved = _with_parameters(camera, _parameters(camera) + step[at : at + count])
        if moved is None:
            return None
        cameras.append(moved)
        at += count
        if number:
            poses.append(_turned(rig.poses[number], step[at : at + 6]))
            at += 6
    return _Rig(tuple(cameras), tuple(poses), {k: _turned(T, boards[k]) for k, T in rig.boards.items()})


def _turned(T: FloatArray, step: FloatArray) -> FloatArray:
    """Return ``(t + step[:3], Exp(step[3:]) R)``."""
    return se3.transform(se3.exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])


def _parameters(camera: CameraModel) -> FloatArray:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def _with_parameters(camera: CameraModel, values: FloatArray) -> CameraModel | None:
    fx, fy, cx, cy, *distortion = (float(v) for v in values)
    try:
        return replace(camera, fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))
    except InputError:
        return None


def _in_camera(rig: _Rig, view: View) -> tuple[FloatArray, FloatArray]:
    """Return the corners in the first camera and in the camera of the view."""
    T, P = rig.boards[view.board], rig.poses[view.camera]
    first = view.corners_m @ T[:3, :3].T + T[:3, 3]
    return first, first @ P[:3, :3].T + P[:3, 3]


def _residuals(rig: _Rig, views: Sequence[View]) -> list[FloatArray]:
    """Return measured minus computed pixels of each view; 1000 px where the corner is invisible."""
    return [
        np.nan_to_num(view.pixels - rig.cameras[view.camera].project(_in_camera(rig, view)[1]), nan=1e3)
        for view in views
    ]


def _scale(residuals: Sequence[FloatArray]) -> float:
    return max(1.4826 * float(np.median(np.abs(np.concatenate(residuals)))), _FLOOR_PX)


def _weights(r: FloatArray, sigma_px: float) -> FloatArray:
    """Return Huber's weights ``(k, 1)`` divided by the variance."""
    norm = np.linalg.norm(r, axis=1, keepdims=True) / sigma_px
    return np.asarray(np.minimum(1.0, 2.0 * _HUBER / np.maximum(norm, 1e-12)) / sigma_px**2)


def _cost(rig: _Rig, views: Sequence[View], sigma_px: float) -> float:
    norm = np.linalg.norm(np.concatenate(_residuals(rig, views)), axis=1) / sigma_px
    limit = 2.0 * _HUBER
    return float(np.where(norm < limit, 0.5 * norm**2, limit * (norm - 0.5 * limit)).sum())


def _normal_equations(
    rig: _Rig, views: Sequence[View], sigma_px: float, damping: float = 0.0
) -> tuple[FloatArray, FloatArray, dict[int, FloatArray], dict[int, FloatArray], dict[int, FloatArray]]:
    """Return the reduced normal equations of the shared parameters, and the blocks of each board.

    The blocks are the inverse of its own block, the cross block and the right side.
    """
    counts = [4 + len(c.distortion) + (6 if n else 0) for n, c in enumerate(rig.cameras)]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    size = int(offsets[-1])
    A, g = np.zeros((size, size)), np.zeros(size)
    blocks = {k: np.zeros((6, 6)) for k in rig.boards}
    crosses = {k: np.zeros((size, 6)) for k in rig.boards}
    own = {k: np.zeros(6) for k in rig.boards}
    for view, r in zip(views, _residuals(rig, views), strict=True):
        J, Jb = _jacobians(rig, view)
        w = _weights(r, sigma_px).repeat(2, axis=1).reshape(-1)
        rows = slice(int(offsets[view.camera]), int(offsets[view.camera + 1]))
        A[rows, rows] += J.T @ (J * w[:, None])
        g[rows] += J.T @ (w * r.reshape(-1))
        blocks[view.board] += Jb.T @ (Jb * w[:, None])
        crosses[view.board][rows] += J.T @ (Jb * w[:, None])
        own[view.board] += Jb.T @ (w * r.reshape(-1))
    inverses = {k: _inverse(B + damping * np.diag(np.diag(B))) for k, B in blocks.items()}
    for k, inverse in inverses.items():
        A -= crosses[k] @ inverse @ crosses[k].T
        g -= crosses[k] @ inverse @ own[k]
    return A, g, inverses, crosses, own


def _inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of a symmetric matrix; directions without information get a large variance."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    values = np.maximum(values, _LEAST_EIGENVALUE * max(float(values.max()), 1e-300))
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale), np.float64)


def _jacobians(rig: _Rig, view: View) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of the pixels ``(2 k, shared)`` and ``(2 k, 6)``.

    The first are those with respect to the camera (after the first also its pose), the second those with
    respect to the pose of the board.
    """
    camera, P = rig.cameras[view.camera], rig.poses[view.camera]
    T = rig.boards[view.board]
    first, points = _in_camera(rig, view)
    values = _parameters(camera)
    steps = np.maximum(np.abs(values), 1.0) * 1e-6
    intrinsic = np.empty((len(points), 2, len(values)))
    for k, step in enumerate(steps):
        delta = np.zeros(len(values))
        delta[k] = step
        up, down = _with_parameters(camera, values + delta), _with_parameters(camera, values - delta)
        if up is None or down is None:
            intrinsic[:, :, k] = 0.0
            continue
        intrinsic[:, :, k] = (up.project(points) - down.project(points)) / (2.0 * step)
    h = 1e-6 * max(float(np.abs(points).max()), 1e-3)
    by_point = np.stack(
        [(camera.project(points + h * e) - camera.project(points - h * e)) / (2.0 * h) for e in np.eye(3)],
        axis=2,
    )
    intrinsic, by_point = np.nan_to_num(intrinsic), np.nan_to_num(by_point)
    shared = intrinsic.reshape(-1, len(values))
    if view.camera:
        turned = first @ P[:3, :3].T
        pose = np.concatenate([by_point, -by_point @ se3.skew(turned)], axis=2)
        shared = np.hstack([shared, pose.reshape(-1, 6)])
    by_first = by_point @ P[:3, :3]
    rotated = view.corners_m @ T[:3, :3].T
    board = np.concatenate([by_first, -by_first @ se3.skew(rotated)], axis=2)
    return shared, board.reshape(-1, 6)
