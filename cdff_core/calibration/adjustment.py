# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Adjustment of a rig of cameras and of the poses of the boards that they see.

The robust cost of the corners is minimised by Levenberg-Marquardt; the poses of the boards are eliminated by
the Schur complement [1]_.

References
----------
.. [1] Triggs, B., et al. (2000). Bundle adjustment: a modern synthesis. doi:10.1007/3-540-44480-7_21
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
#: Threshold of Huber's loss, standard deviations of a coordinate.
_HUBER = 1.5
#: Smallest assumed standard deviation of a corner, pixels, so that exact corners stay regular.
_FLOOR_PX = 1e-3
_ITERATIONS = 60
#: Smallest eigenvalue of normal equations with unit diagonal, relative to the largest.
_LEAST_EIGENVALUE = 1e-13


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
class Rig:
    """Estimate: cameras, their poses T_camera_first, and the poses T_first_board by board."""

    cameras: tuple[CameraModel, ...]
    poses: tuple[FloatArray, ...]
    boards: dict[int, FloatArray]


def parameter_names(rig: Rig) -> tuple[str, ...]:
    """Return the names of the shared parameters, as in ``RigCalibration.names``."""
    names = []
    for number, camera in enumerate(rig.cameras):
        coefficients = COEFFICIENT_NAMES[camera.lens][: len(camera.distortion)]
        names += [f"{number}.{name}" for name in ("fx", "fy", "cx", "cy", *coefficients)]
        if number:
            names += [f"{number}.{name}" for name in ("x", "y", "z", "rx", "ry", "rz")]
    return tuple(names)


def adjusted(rig: Rig, views: Sequence[View], is_free: BoolArray) -> Rig:
    """Return the rig with the least robust cost, by Levenberg-Marquardt."""
    damping = 1e-3
    sigma_px = corner_sigma(corner_residuals(rig, views))
    cost = robust_cost(rig, views, sigma_px)
    for _ in range(_ITERATIONS):
        S, g, inverses, crosses, own = normal_equations(rig, views, sigma_px, damping)
        improved = False
        while damping < 1e9:
            damped = S[np.ix_(is_free, is_free)] + damping * np.diag(np.diag(S)[is_free])
            step = np.zeros(len(g))
            step[is_free] = regular_inverse(damped) @ g[is_free]
            boards = {k: inverses[k] @ (own[k] - crosses[k].T @ step) for k in rig.boards}
            trial = _moved(rig, step, boards)
            trial_cost = np.inf if trial is None else robust_cost(trial, views, sigma_px)
            if trial is not None and trial_cost < cost:
                improved = True
                break
            damping *= 8.0
            S, g, inverses, crosses, own = normal_equations(rig, views, sigma_px, damping)
        if not improved or trial is None:
            break
        change = (cost - trial_cost) / max(cost, 1e-12)
        rig, damping = trial, max(damping / 8.0, 1e-9)
        sigma_px = corner_sigma(corner_residuals(rig, views))
        cost = robust_cost(rig, views, sigma_px)
        if change < 1e-9:
            break
    if not np.isfinite(cost):
        raise DegenerateGeometryError(
            "the adjustment of the cameras does not converge; take other views of the board"
        )
    return rig


def _moved(rig: Rig, step: FloatArray, boards: dict[int, FloatArray]) -> Rig | None:
    """Return the rig after a step; None if a camera would be invalid."""
    cameras, poses, at = [], [rig.poses[0]], 0
    for number, camera in enumerate(rig.cameras):
        count = 4 + len(camera.distortion)
        moved = with_intrinsic_values(camera, intrinsic_values(camera) + step[at : at + count])
        if moved is None:
            return None
        cameras.append(moved)
        at += count
        if number:
            poses.append(moved_pose(rig.poses[number], step[at : at + 6]))
            at += 6
    return Rig(tuple(cameras), tuple(poses), {k: moved_pose(T, boards[k]) for k, T in rig.boards.items()})


def moved_pose(T: FloatArray, step: FloatArray) -> FloatArray:
    """Return ``(t + step[:3], Exp(step[3:]) R)``."""
    return se3.transform(se3.exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])


def intrinsic_values(camera: CameraModel) -> FloatArray:
    """Return fx, fy, cx, cy (pixels) and the coefficients of the lens, ``(4 + c,)``."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def with_intrinsic_values(camera: CameraModel, values: FloatArray) -> CameraModel | None:
    """Return the camera with other ``intrinsic_values``; None if it would be invalid."""
    fx, fy, cx, cy, *distortion = (float(v) for v in values)
    try:
        return replace(camera, fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))
    except InputError:
        return None


def _in_camera(rig: Rig, view: View) -> tuple[FloatArray, FloatArray]:
    """Return the corners in the first camera and in the camera of the view."""
    T, P = rig.boards[view.board], rig.poses[view.camera]
    first = view.corners_m @ T[:3, :3].T + T[:3, 3]
    return first, first @ P[:3, :3].T + P[:3, 3]


def corner_residuals(rig: Rig, views: Sequence[View]) -> list[FloatArray]:
    """Return measured minus computed pixels of each view; 1000 px where the corner is invisible."""
    return [
        np.nan_to_num(view.pixels - rig.cameras[view.camera].project(_in_camera(rig, view)[1]), nan=1e3)
        for view in views
    ]


def corner_sigma(residuals: Sequence[FloatArray]) -> float:
    """Return the robust standard deviation of a coordinate of a corner, pixels."""
    return max(1.4826 * float(np.median(np.abs(np.concatenate(residuals)))), _FLOOR_PX)


def huber_weights(r: FloatArray, sigma_px: float) -> FloatArray:
    """Return Huber's weights ``(k, 1)`` divided by the variance."""
    norm = np.linalg.norm(r, axis=1, keepdims=True) / sigma_px
    return np.asarray(np.minimum(1.0, 2.0 * _HUBER / np.maximum(norm, 1e-12)) / sigma_px**2)


def robust_cost(rig: Rig, views: Sequence[View], sigma_px: float) -> float:
    """Return the sum of Huber's loss over all corners."""
    norm = np.linalg.norm(np.concatenate(corner_residuals(rig, views)), axis=1) / sigma_px
    limit = 2.0 * _HUBER
    return float(np.where(norm < limit, 0.5 * norm**2, limit * (norm - 0.5 * limit)).sum())


def normal_equations(
    rig: Rig, views: Sequence[View], sigma_px: float, damping: float = 0.0
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
    for view, r in zip(views, corner_residuals(rig, views), strict=True):
        J, Jb = jacobians(rig, view)
        w = huber_weights(r, sigma_px).repeat(2, axis=1).reshape(-1)
        rows = slice(int(offsets[view.camera]), int(offsets[view.camera + 1]))
        A[rows, rows] += J.T @ (J * w[:, None])
        g[rows] += J.T @ (w * r.reshape(-1))
        blocks[view.board] += Jb.T @ (Jb * w[:, None])
        crosses[view.board][rows] += J.T @ (Jb * w[:, None])
        own[view.board] += Jb.T @ (w * r.reshape(-1))
    inverses = {k: regular_inverse(B + damping * np.diag(np.diag(B))) for k, B in blocks.items()}
    for k, inverse in inverses.items():
        A -= crosses[k] @ inverse @ crosses[k].T
        g -= crosses[k] @ inverse @ own[k]
    return A, g, inverses, crosses, own


def regular_inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of a symmetric matrix; directions without information get a large variance."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    values = np.maximum(values, _LEAST_EIGENVALUE * max(float(values.max()), 1e-300))
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale), np.float64)


def jacobians(rig: Rig, view: View) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of the pixels ``(2 k, shared)`` and ``(2 k, 6)``.

    The first are those with respect to the camera (after the first also its pose), the second those with
    respect to the pose of the board.
    """
    camera, P = rig.cameras[view.camera], rig.poses[view.camera]
    T = rig.boards[view.board]
    first, points = _in_camera(rig, view)
    values = intrinsic_values(camera)
    steps = np.maximum(np.abs(values), 1.0) * 1e-6
    intrinsic = np.empty((len(points), 2, len(values)))
    for k, step in enumerate(steps):
        delta = np.zeros(len(values))
        delta[k] = step
        up, down = (
            with_intrinsic_values(camera, values + delta),
            with_intrinsic_values(camera, values - delta),
        )
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
