# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance of a registered pose by errors that many points share: those of a ring, and those on a plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray
from cdff_common.geometry.small_vectors import cross, rotated
from cdff_core.dfns.scan_to_map_registration._kernels import (
    deskew_point,
    nearest_plane,
    weighted_distance,
)
from cdff_core.dfns.scan_to_map_registration._optimisation import Estimate
from cdff_core.dfns.scan_to_map_registration._voxel_map import VoxelMap
from cdff_core.dfns.scan_to_map_registration._voxel_table import NORMAL, VoxelTable

#: Number of bins of elevation from -90 to 90 degrees; the points of a bin belong to one ring.
_RING_BINS = 720


@dataclass(frozen=True, slots=True)
class CalibrationErrors:
    """Standard deviations of constant errors of a lidar.

    Errors of different rings are independent (Glennie, Lichti 2010, doi:10.3390/rs2061610).
    """

    range_m: float  # standard deviation of the error that all rings share
    ring_range_m: float
    ring_elevation_rad: float


def shared_error_covariances(
    local_map: VoxelMap,
    points: FloatArray,
    point_times: FloatArray,
    pose_estimate: Estimate,
    kernel_m: float,
    errors: CalibrationErrors,
) -> tuple[FloatArray, FloatArray]:
    """Return two covariances (6, 6) of T_map_sensor: due to errors shared by the points on a plane, from the
    residuals, and due to the calibration of the lidar.

    The first one is the sandwich estimate clustered by plane (Liang, Zeger 1986, doi:10.1093/biomet/73.1.13):
    points on the same plane share its error, and points of dust or moving objects pull against the others.
    For the second one, all points of a ring have the same error, so that their number does not reduce it. The
    map is taken as exact: its own errors become drift as the lidar moves.
    """
    rings, planes = shared_gradients(
        local_map.tables,
        local_map.voxel_m,
        points,
        point_times,
        np.ascontiguousarray(pose_estimate.T[:3, :3]),
        pose_estimate.T[:3, 3].copy(),
        pose_estimate.motion[3:].copy(),
        pose_estimate.motion[:3].copy(),
        kernel_m,
        pose_estimate.noise_m,
    )
    to_pose = np.linalg.inv(pose_estimate.information)[:, :6] / pose_estimate.variance  # from gradients
    by_plane, by_range, by_elevation = planes @ to_pose, rings[:, 0] @ to_pose, rings[:, 1] @ to_pose
    common = by_range.sum(axis=0)
    calibration = (
        errors.range_m**2 * np.outer(common, common)
        + errors.ring_range_m**2 * by_range.T @ by_range
        + errors.ring_elevation_rad**2 * by_elevation.T @ by_elevation
    )
    return np.asarray(by_plane.T @ by_plane), np.asarray(calibration)


@njit(cache=True)
def shared_gradients(
    tables: tuple[VoxelTable, ...],
    voxel: float,
    points: FloatArray,
    point_times: FloatArray,
    R_map_sensor: FloatArray,
    t_map_sensor: FloatArray,
    theta: FloatArray,
    rho: FloatArray,
    kernel: float,
    noise: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return the gradients of the objective of ``normal_equations``, summed over points with a common error.

    Returns
    -------
    rings : ndarray, shape (b, 2, 12)
        Derivatives with respect to the errors of each ring: range, metres, and elevation, radians.
    planes : ndarray, shape (m, 12)
        Gradient due to the points of each plane.
    """
    rings, planes = np.zeros((_RING_BINS, 2, 12)), np.zeros((len(points), 12))
    starts = np.zeros(len(tables) + 1, np.int64)
    for level in range(len(tables)):
        starts[level + 1] = starts[level] + len(tables[level].keys)
    number_of_plane = np.full(starts[-1], -1)
    n = 0
    J, q = np.empty(12), np.empty(3)
    for p in range(len(points)):
        f = point_times[p]
        px, py, pz = points[p]
        deskew_point(points[p], f, theta, rho, q)
        ax, ay, az = rotated(R_map_sensor, q[0], q[1], q[2])
        x, y, z = ax + t_map_sensor[0], ay + t_map_sensor[1], az + t_map_sensor[2]
        level, row = nearest_plane(tables, voxel, 0, x, y, z)
        if row < 0:
            continue
        plane = tables[level].planes[row]
        nx, ny, nz = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
        r, w = weighted_distance(plane, x, y, z, kernel, noise[level], noise[0])
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = cross(ax, ay, az, nx, ny, nz)
        bx, by, bz = rotated(R_map_sensor.T, nx, ny, nz)
        J[6], J[7], J[8] = bx, by, bz
        J[9], J[10], J[11] = cross(q[0], q[1], q[2], bx, by, bz)
        horizontal, range_m = math.hypot(px, py), math.sqrt(px * px + py * py + pz * pz)
        if range_m == 0.0 or horizontal == 0.0:
            continue
        along = (px * bx + py * by + pz * bz) / range_m
        upwards = horizontal * bz - pz * (px * bx + py * by) / horizontal
        ring = min(int((math.atan2(pz, horizontal) / math.pi + 0.5) * _RING_BINS), _RING_BINS - 1)
        number = number_of_plane[starts[level] + row]
        if number < 0:
            number, n = n, n + 1
            number_of_plane[starts[level] + row] = number
        for i in range(12):
            wj = w * J[i] * (f if i >= 6 else 1.0)
            rings[ring, 0, i] += wj * along
            rings[ring, 1, i] += wj * upwards
            planes[number, i] += wj * r
    return rings, planes[:n]
