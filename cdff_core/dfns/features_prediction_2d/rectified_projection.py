# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Projection of known points into a rectified pair."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_prediction_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.rectified_camera import RectifiedCamera

_NEAREST_M = 1e-3
_BORDER_PX = 8  # half a patch of the trackers, and a pixel
_MAX_MAGNIFICATION = 2.0  # of a patch that can be tracked, and of its reduction
_EDGE_ON = 0.05  # smallest area ratio of a patch whose warp is used


class RectifiedProjection(Interface[DfnConfig]):
    """Pinhole projection [1]_; the warp of a patch is that of the plane given by the gradient of its
    disparity.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §6.1
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the projected points; raises InputError on an invalid camera."""
        camera = RectifiedCamera.from_matrix(inputs.camera_matrix, inputs.baseline)
        moved = se3.transform_points(inputs.pose, inputs.points)
        ahead = moved[:, 2] > _NEAREST_M
        moved[~ahead, 2] = _NEAREST_M
        uvd = camera.project(moved)
        rows, columns = inputs.image.shape
        inside = np.all(
            (uvd[:, :2] >= _BORDER_PX) & (uvd[:, :2] < np.array([columns, rows]) - _BORDER_PX), axis=1
        )
        magnification = np.asarray(inputs.points)[:, 2] / moved[:, 2]
        slopes = np.zeros((len(moved), 2)) if inputs.slopes is None else np.asarray(inputs.slopes, np.float64)
        warps, seen = _warped(camera, np.asarray(inputs.points, np.float64), inputs.pose, slopes)
        followed = (magnification <= _MAX_MAGNIFICATION) & (magnification >= 1.0 / _MAX_MAGNIFICATION)
        return Outputs(
            features=np.ascontiguousarray(uvd[:, :2]),
            disparities=np.ascontiguousarray(uvd[:, 2]),
            warps=warps,
            slopes=seen,
            visible=ahead & inside & followed,
        )


def _warped(
    camera: RectifiedCamera, points: FloatArray, pose: FloatArray, slopes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return homographies ``(n, 3, 3)`` of offsets around points, and the new disparity gradients ``(n, 2)``.

    A patch is a plane ``1 / z = n . (x, y, 1)`` and moves by the homography ``R + t n^T`` ([1]_, §13.1).
    Second order matters: without it the mean of a patch on ground approached by a fifth of its distance has
    an error of 0.01 px. A patch seen edge-on is not changed.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685
    """
    z, focal = points[:, 2], np.array([camera.fx, camera.fy])
    bearings = points / z[:, None]
    normals = np.empty((len(points), 3))
    normals[:, :2] = slopes * focal / (camera.fx * camera.baseline_m)
    normals[:, 2] = 1.0 / z - np.sum(normals[:, :2] * bearings[:, :2], axis=1)
    H = pose[:3, :3] + pose[:3, 3][:, None] * normals[:, None, :]
    moved = np.einsum("nij,nj->ni", H, bearings)
    stretch = np.maximum(moved[:, 2], _NEAREST_M)
    warps = np.tile(np.eye(3), (len(points), 1, 1))
    towards = H[:, 2, :2] / stretch[:, None]
    warps[:, :2, :2] = (
        H[:, :2, :2] / stretch[:, None, None]
        - (moved[:, :2] / stretch[:, None])[:, :, None] * towards[:, None]
    )
    warps[:, :2, :2] *= focal[:, None] / focal
    warps[:, 2, :2] = towards / focal
    growth = normals[:, :2] / stretch[:, None] - towards / (z * stretch)[:, None]  # of 1 / z, by x and y
    growth *= camera.fx * camera.baseline_m / focal
    edge_on = np.linalg.det(warps) < _EDGE_ON
    warps[edge_on], growth[edge_on] = np.eye(3), 0.0
    return warps, np.linalg.solve(np.swapaxes(warps[:, :2, :2], 1, 2), growth[:, :, None])[:, :, 0]
