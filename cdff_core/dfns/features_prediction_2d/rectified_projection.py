# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Projection of known points into a rectified image pair."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_prediction_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.rectified_camera import RectifiedCamera

#: Depth below which a point is behind the camera.
_MIN_DEPTH_M = 1e-3
_BORDER_PX = 8  # half the width of a patch of the trackers, and one pixel
_MAX_MAGNIFICATION = 2.0  # of a patch that can be tracked; its inverse is the smallest magnification
_MIN_AREA_RATIO = (
    0.05  # smallest ratio of the areas of a warped and the original patch; below it the patch is seen edge-on
)


class RectifiedProjection(Interface[DfnConfig]):
    """Pinhole projection [1]_; patches are warped as planes given by the gradient of their disparity.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §6.1
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the projected points; raises InputError on an invalid camera."""
        camera = RectifiedCamera.from_matrix(inputs.camera_matrix, inputs.baseline)
        points_in_camera = se3.transform_points(inputs.pose, inputs.points)
        in_front = points_in_camera[:, 2] > _MIN_DEPTH_M
        points_in_camera[~in_front, 2] = _MIN_DEPTH_M
        uvd = camera.project(points_in_camera)
        rows, columns = inputs.image.shape
        is_inside = np.all(
            (uvd[:, :2] >= _BORDER_PX) & (uvd[:, :2] < np.array([columns, rows]) - _BORDER_PX), axis=1
        )
        magnification = np.asarray(inputs.points)[:, 2] / points_in_camera[:, 2]
        slopes = (
            np.zeros((len(points_in_camera), 2))
            if inputs.slopes is None
            else np.asarray(inputs.slopes, np.float64)
        )
        warps, predicted_slopes = _warps_and_slopes(
            camera, np.asarray(inputs.points, np.float64), inputs.pose, slopes
        )
        is_magnification_valid = (magnification <= _MAX_MAGNIFICATION) & (
            magnification >= 1.0 / _MAX_MAGNIFICATION
        )
        return Outputs(
            features=np.ascontiguousarray(uvd[:, :2]),
            disparities=np.ascontiguousarray(uvd[:, 2]),
            warps=warps,
            slopes=predicted_slopes,
            visible=in_front & is_inside & is_magnification_valid,
        )


def _warps_and_slopes(
    camera: RectifiedCamera, points: FloatArray, pose: FloatArray, slopes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return homographies ``(n, 3, 3)`` of offsets around points, and predicted slopes ``(n, 2)``.

    Slopes are the gradients of the disparity by column and row.

    A patch is a plane ``1 / z = n . (x, y, 1)`` and moves by the homography ``R + t n^T`` ([1]_, §13.1).
    An affine warp would not suffice: on ground approached by a fifth of its distance, the mean position of a
    patch would have an error of 0.01 px. Patches seen edge-on are not warped.

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
    warped_bearings = np.einsum("nij,nj->ni", H, bearings)
    depth_ratio = np.maximum(warped_bearings[:, 2], _MIN_DEPTH_M)
    warps = np.tile(np.eye(3), (len(points), 1, 1))
    perspective = H[:, 2, :2] / depth_ratio[:, None]
    warps[:, :2, :2] = (
        H[:, :2, :2] / depth_ratio[:, None, None]
        - (warped_bearings[:, :2] / depth_ratio[:, None])[:, :, None] * perspective[:, None]
    )
    warps[:, :2, :2] *= focal[:, None] / focal
    warps[:, 2, :2] = perspective / focal
    # Gradient of 1 / z by the coordinates of the reference image, then of the disparity in pixels.
    disparity_gradient = normals[:, :2] / depth_ratio[:, None] - perspective / (z * depth_ratio)[:, None]
    disparity_gradient *= camera.fx * camera.baseline_m / focal
    edge_on = np.linalg.det(warps) < _MIN_AREA_RATIO
    warps[edge_on], disparity_gradient[edge_on] = np.eye(3), 0.0
    to_predicted = np.swapaxes(warps[:, :2, :2], 1, 2)
    return warps, np.linalg.solve(to_predicted, disparity_gradient[:, :, None])[:, :, 0]
