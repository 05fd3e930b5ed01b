# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Captures as clouds at the pixels of a camera, with normals and standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cdff_common.arrays import ByteArray, Float32Array, FloatArray
from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.imaging.grey import rgb_image

#: Tangent of the largest angle between a point of a cloud and the middle of the cloud, seen from the sensor,
#: and largest number of pixels.
_MAX_TANGENT, _MAX_PIXELS = 1.8, 2_000_000
#: Distance in pixels up to which a pixel takes the nearest point of a cloud.
_REACH_PX = 0.8
#: Half width of the differences that give the normals of a depth image, pixels.
_HALF_PX = 2


@dataclass(frozen=True, slots=True, eq=False)
class OrganisedCloud:
    """Points at the pixels of a camera.

    Attributes
    ----------
    points, normals : ndarray of float32, shape (rows, columns, 3)
        In the frame of the camera; NaN where none.
    sigmas : ndarray of float32, shape (rows, columns)
        Standard deviations along the rays, metres.
    camera_matrix : ndarray of float64, shape (3, 3)
    T_sensor_camera : ndarray of float64, shape (4, 4)
    """

    points: Float32Array
    normals: Float32Array
    sigmas: Float32Array
    camera_matrix: FloatArray
    T_sensor_camera: FloatArray

    def scale_m(self) -> float:
        """Return the larger of the median distance between points and 1.5 times their standard deviation."""
        is_point = np.isfinite(self.normals).all(axis=2)
        if not is_point.any():
            raise InputError("capture without a point that has a normal: no edge of voxels follows from it")
        spacing = np.median(self.points[is_point][:, 2]) / self.camera_matrix[0, 0]
        return float(max(spacing, 1.5 * np.median(self.sigmas[is_point])))


def of_depth(z: FloatArray, K: FloatArray, sigma_z: FloatArray, max_step: float) -> OrganisedCloud:
    """Return the cloud of depths; normals by central differences within a surface.

    Parameters
    ----------
    sigma_z : ndarray of float64, shape (rows, columns)
        Standard deviations of the depths.
    max_step : float
        Difference of depths, in widths of a pixel, that divides surfaces.
    """
    rows, columns = z.shape
    rays = np.stack(
        np.broadcast_arrays(
            (np.arange(columns) - K[0, 2]) / K[0, 0],
            ((np.arange(rows) - K[1, 2]) / K[1, 1])[:, None],
            1.0,
        ),
        axis=2,
    )
    points = rays * z[:, :, None]
    h = _HALF_PX
    right, down = np.full_like(points, np.nan), np.full_like(points, np.nan)
    right[:, h:-h] = points[:, 2 * h :] - points[:, : -2 * h]
    down[h:-h] = points[2 * h :] - points[: -2 * h]
    normals = np.cross(down, right)
    with np.errstate(invalid="ignore", divide="ignore"):
        limit = max_step * 2 * h * z / K[0, 0] + 3.0 * sigma_z
        is_edge = np.maximum(np.abs(right[:, :, 2]), np.abs(down[:, :, 2])) > limit
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        normals[is_edge | np.isnan(z)] = np.nan
    return OrganisedCloud(
        points.astype(np.float32), normals.astype(np.float32), sigma_z.astype(np.float32), K, np.eye(4)
    )


def of_cloud(points: FloatArray, normals: FloatArray, sigma_m: float) -> OrganisedCloud:
    """Return points and normals ``(n, 3)`` arranged on the pixels of a camera that looks at their middle.

    Raises
    ------
    InputError
        If fewer than 16 points are within 60 degrees of the middle.
    """
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    R = _looking_at(directions.mean(axis=0))
    camera_points = points @ R
    in_view = camera_points[:, 2] > 0.0
    plane = camera_points[in_view, :2] / camera_points[in_view, 2:]
    is_near = (np.abs(plane) < _MAX_TANGENT).all(axis=1)
    in_view[in_view] = is_near
    plane = plane[is_near]
    if len(plane) < 16:
        raise InputError(f"cloud with {len(plane)} points within 60 degrees of its middle, expected 16")
    tree = cKDTree(plane)
    spacing = float(np.median(tree.query(plane, k=2)[0][:, 1]))
    low, high = plane.min(axis=0), plane.max(axis=0)
    spacing = max(spacing, float(np.sqrt(np.prod(high - low + 1e-12) / _MAX_PIXELS)), 1e-6)
    columns, rows = np.floor((high - low) / spacing).astype(int) + 1
    K = np.array(
        [[1 / spacing, 0.0, -low[0] / spacing], [0.0, 1 / spacing, -low[1] / spacing], [0.0, 0.0, 1.0]]
    )
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=2) * spacing + low
    _, nearest = tree.query(grid.reshape(-1, 2), distance_upper_bound=_REACH_PX * spacing)
    padded = np.concatenate([camera_points[in_view], np.full((1, 3), np.nan)])
    padded_normals = np.concatenate([(normals @ R)[in_view], np.full((1, 3), np.nan)])
    points_of_pixels, normals_of_pixels = padded[nearest], padded_normals[nearest]
    T = np.eye(4)
    T[:3, :3] = R
    return OrganisedCloud(
        points_of_pixels.reshape(rows, columns, 3).astype(np.float32),
        normals_of_pixels.reshape(rows, columns, 3).astype(np.float32),
        np.full((rows, columns), sigma_m, np.float32),
        K,
        T,
    )


def colors_of(cloud: OrganisedCloud, image: Frame, T_image_sensor: FloatArray) -> ByteArray:
    """Return the colours ``(rows, columns, 3)`` of the points in an image; black outside of it."""
    pixels, K = rgb_image(image), image.camera_matrix
    T = T_image_sensor @ cloud.T_sensor_camera
    with np.errstate(invalid="ignore", divide="ignore"):
        points_in_camera = cloud.points @ T[:3, :3].T + T[:3, 3]
        u = np.rint(K[0, 0] * points_in_camera[:, :, 0] / points_in_camera[:, :, 2] + K[0, 2])
        v = np.rint(K[1, 1] * points_in_camera[:, :, 1] / points_in_camera[:, :, 2] + K[1, 2])
        rows, columns = pixels.shape[:2]
        is_inside = (points_in_camera[:, :, 2] > 0) & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    colors = np.zeros((*is_inside.shape, 3), np.uint8)
    colors[is_inside] = pixels[v[is_inside].astype(int), u[is_inside].astype(int)]
    return colors


def _looking_at(direction: FloatArray) -> FloatArray:
    """Return the rotation whose third column is a direction."""
    z = direction / max(float(np.linalg.norm(direction)), 1e-12)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
