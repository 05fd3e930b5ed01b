# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of a board in one image of a calibrated camera, with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel
from cdff_core.calibration.adjustment import (
    Rig,
    View,
    corner_residuals,
    corner_sigma,
    huber_weights,
    jacobians,
    regular_inverse,
)
from cdff_core.calibration.rig import plane_poses, refined_board

#: Corners further from their computed pixels than this number of standard deviations are dropped.
_GATE = 5.0
#: Standard deviation of a corner with which the refinement starts, and smallest one, pixels.
_START_PX, _FLOOR_PX = 1.0, 0.02
#: RMS of the corners of a view, pixels, above which the pose is not used.
_LARGEST_RMS_PX = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class BoardPose:
    """Pose of a board.

    Attributes
    ----------
    number : int
        Number of the image.
    T_camera_board : ndarray, shape (4, 4)
    covariance : ndarray, shape (6, 6)
        Of the pose in the frame of the camera, without errors of the intrinsic parameters.
    rms_px : float
    """

    number: int
    T_camera_board: FloatArray
    covariance: FloatArray
    rms_px: float


def board_poses_of(camera: CameraModel, views: Sequence[View]) -> list[BoardPose]:
    """Return the pose of the board in each view that has one; views without a usable pose are left out.

    Of the two poses that a view of a plane permits, the one with the smaller residuals is returned.
    """
    found: list[tuple[View, FloatArray]] = []
    for view in views:
        own = replace(view, camera=0)
        if (T := _best_pose(camera, own)) is not None:
            found.append((own, T))
    if not found:
        return []
    residuals = [corner_residuals(_rig(camera, view, T), [view])[0] for view, T in found]
    sigma_px = max(corner_sigma(residuals), _FLOOR_PX)
    poses = []
    for (view, start), r in zip(found, residuals, strict=True):
        is_kept = np.linalg.norm(r, axis=1) < _GATE * max(sigma_px, corner_sigma([r]))
        if is_kept.sum() < 6:
            continue
        own = replace(
            view,
            corners_m=view.corners_m[is_kept],
            pixels=view.pixels[is_kept],
            numbers=view.numbers[is_kept],
        )
        _, T = refined_board(_rig(camera, own, start), [own], own.board, start, sigma_px)
        rig = _rig(camera, own, T)
        left = corner_residuals(rig, [own])[0]
        rms_px = float(np.sqrt((left**2).sum(axis=1).mean()))
        if rms_px > _LARGEST_RMS_PX:
            continue
        J = jacobians(rig, own)[1]
        w = huber_weights(left, sigma_px).repeat(2, axis=1).reshape(-1)
        poses.append(BoardPose(view.board, T, regular_inverse(J.T @ (J * w[:, None])), rms_px))
    return poses


def _rig(camera: CameraModel, view: View, T: FloatArray) -> Rig:
    return Rig((camera,), (np.eye(4),), {view.board: T})


def _best_pose(camera: CameraModel, view: View) -> FloatArray | None:
    options = plane_poses(camera, view)
    if not options:
        return None
    refined = [
        refined_board(_rig(camera, view, T), [view], view.board, T, sigma_px=_START_PX) for T in options
    ]
    return min(refined, key=lambda pair: pair[0])[1]
