# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over voxels: addition of an image, and extraction of the surface."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.arrays import ByteArray, Float32Array, FloatArray, IntArray
from cdff_common.geometry.small_vectors import inverse_translation, transformed

CountArray = NDArray[np.uint16]


#: A row of a rotation, or a translation: three numbers.
_Three = tuple[float, float, float]


@njit(cache=True, error_model="numpy", inline="always")
def _project_measurement(
    position: tuple[float, float, float],
    truncation_m: float,
    min_cosine: float,
    T_camera_model: FloatArray,
    K: FloatArray,
    points: Float32Array,
    normals: Float32Array,
) -> tuple[int, int, float, float]:
    """Return row, column, distance from the plane of this pixel and cosine of incidence.

    The row is -1 if the position is not observed, -2 if it is hidden behind the pixel's point.
    """
    x, y, z = position
    camera_x, camera_y, camera_z = transformed(T_camera_model, x, y, z)
    if not camera_z > 0.0:
        return -1, -1, 0.0, 0.0
    column = math.floor(K[0, 0] * camera_x / camera_z + K[0, 2] + 0.5)
    row = math.floor(K[1, 1] * camera_y / camera_z + K[1, 2] + 0.5)
    if not (0 <= column < points.shape[1] and 0 <= row < points.shape[0]):
        return -1, -1, 0.0, 0.0
    nx, ny, nz = normals[row, column, 0], normals[row, column, 1], normals[row, column, 2]
    px, py, pz = points[row, column, 0], points[row, column, 1], points[row, column, 2]
    if not (nz == nz and pz == pz):
        return -1, -1, 0.0, 0.0
    cosine = -(nx * px + ny * py + nz * pz) / math.sqrt(px * px + py * py + pz * pz)
    if cosine < min_cosine:
        return -1, -1, 0.0, 0.0
    range_m = math.sqrt(camera_x * camera_x + camera_y * camera_y + camera_z * camera_z)
    in_front = (pz - camera_z) * range_m / camera_z
    distance = nx * (camera_x - px) + ny * (camera_y - py) + nz * (camera_z - pz)
    if in_front > truncation_m / cosine or distance > truncation_m:
        distance = truncation_m
    elif in_front < -truncation_m / cosine or distance < -truncation_m:
        return -2, -1, 0.0, 0.0
    return row, column, distance, cosine


@njit(cache=True, error_model="numpy")
def disagreement(
    coordinates: IntArray,
    slots: IntArray,
    voxel_m: float,
    truncation_m: float,
    min_cosine: float,
    T_camera_model: FloatArray,
    K: FloatArray,
    points: Float32Array,
    normals: Float32Array,
    distances: Float32Array,
    views: CountArray,
) -> tuple[int, int]:
    """Return the voxels near the previous surface that an image shows or hides, and those it contradicts.

    An image contradicts a voxel if it measures another distance, or hides a surface that faces the camera.
    """
    center_x, center_y, center_z = inverse_translation(T_camera_model)
    compared = contradicted = 0
    for b in range(len(slots)):
        slot = slots[b]
        for v in range(512):
            if views[slot, v] == 0 or abs(distances[slot, v]) > 0.5 * truncation_m:
                continue
            position = (
                (coordinates[b, 0] * 8 + (v >> 6)) * voxel_m,
                (coordinates[b, 1] * 8 + ((v >> 3) & 7)) * voxel_m,
                (coordinates[b, 2] * 8 + (v & 7)) * voxel_m,
            )
            row, _, distance, _ = _project_measurement(
                position, truncation_m, min_cosine, T_camera_model, K, points, normals
            )
            if row >= 0:
                compared += 1
                contradicted += abs(distance - distances[slot, v]) > 0.5 * truncation_m
            elif row == -2:
                i, j, k = v >> 6, (v >> 3) & 7, v & 7
                slope_x = distances[slot, v + 64] - distances[slot, v] if i < 7 else 0.0
                slope_y = distances[slot, v + 8] - distances[slot, v] if j < 7 else 0.0
                slope_z = distances[slot, v + 1] - distances[slot, v] if k < 7 else 0.0
                facing = (
                    slope_x * (center_x - position[0])
                    + slope_y * (center_y - position[1])
                    + slope_z * (center_z - position[2])
                )
                if facing > 0.0:
                    compared += 1
                    contradicted += 1
    return compared, contradicted


@njit(cache=True, error_model="numpy")
def integrate(
    coordinates: IntArray,
    slots: IntArray,
    voxel_m: float,
    truncation_m: float,
    min_cosine: float,
    T_camera_model: FloatArray,
    K: FloatArray,
    points: Float32Array,
    normals: Float32Array,
    sigmas: Float32Array,
    colors: ByteArray,
    distances: Float32Array,
    weights: Float32Array,
    scatters: Float32Array,
    views: CountArray,
    voxel_colors: Float32Array,
) -> None:
    """Update the voxels of blocks with the plane of the pixel that each is projected to.

    ``colors`` without rows adds no colour.
    """
    has_colors = colors.shape[0] > 0
    for b in range(len(slots)):
        slot = slots[b]
        for v in range(512):
            position = (
                (coordinates[b, 0] * 8 + (v >> 6)) * voxel_m,
                (coordinates[b, 1] * 8 + ((v >> 3) & 7)) * voxel_m,
                (coordinates[b, 2] * 8 + (v & 7)) * voxel_m,
            )
            row, column, distance, cosine = _project_measurement(
                position, truncation_m, min_cosine, T_camera_model, K, points, normals
            )
            if row < 0:
                continue
            weight = cosine * cosine / (sigmas[row, column] * sigmas[row, column])
            total = weights[slot, v] + weight
            step = distance - distances[slot, v]
            distances[slot, v] += step * weight / total
            scatters[slot, v] += weight * step * (distance - distances[slot, v])
            weights[slot, v] = total
            if views[slot, v] < 65535:
                views[slot, v] += 1
            if has_colors and abs(distance) < truncation_m:
                total_color = voxel_colors[slot, v, 3] + weight
                for channel in range(3):
                    change = colors[row, column, channel] - voxel_colors[slot, v, channel]
                    voxel_colors[slot, v, channel] += change * weight / total_color
                voxel_colors[slot, v, 3] = total_color


@njit(cache=True, inline="always")
def _at(around: IntArray, b: int, i: int, j: int, k: int) -> tuple[int, int]:
    """Return slot and voxel of the position i, j, k (-8 to 15) relative to block b."""
    slot = around[b, ((i >> 3) + 1) * 9 + ((j >> 3) + 1) * 3 + (k >> 3) + 1]
    return slot, ((i & 7) << 6) + ((j & 7) << 3) + (k & 7)


@njit(cache=True, error_model="numpy")
def surface_vertices(
    coordinates: IntArray,
    around: IntArray,
    voxel_m: float,
    min_views: int,
    distances: Float32Array,
    weights: Float32Array,
    scatters: Float32Array,
    views: CountArray,
    voxel_colors: Float32Array,
    cells: IntArray,
) -> FloatArray:
    """Number the cells that the surface crosses, in ``cells`` (-1 for others); return the vertices.

    Blocks are in the order of their slots. Columns of the vertices: position, colour, standard deviation,
    views.
    """
    count = 0
    for b in range(len(coordinates)):
        for v in range(512):
            cells[b, v] = -1
            i, j, k = v >> 6, (v >> 3) & 7, v & 7
            inside, known = 0, True
            for corner in range(8):
                slot, at = _at(around, b, i + (corner >> 2), j + ((corner >> 1) & 1), k + (corner & 1))
                if slot < 0 or views[slot, at] < min_views:
                    known = False
                    break
                inside += distances[slot, at] < 0.0
            if known and 0 < inside < 8:
                cells[b, v] = count
                count += 1
    vertices = np.zeros((count, 8))
    for b in range(len(coordinates)):
        for v in range(512):
            n = cells[b, v]
            if n < 0:
                continue
            i, j, k = v >> 6, (v >> 3) & 7, v & 7
            x = y = z = 0.0
            crossings = 0
            for axis in range(3):
                for side in range(4):
                    p, q = side >> 1, side & 1
                    di, dj, dk = (0, p, q) if axis == 0 else (p, 0, q) if axis == 1 else (p, q, 0)
                    slot, at = _at(around, b, i + di, j + dj, k + dk)
                    other, other_at = _at(
                        around, b, i + di + (axis == 0), j + dj + (axis == 1), k + dk + (axis == 2)
                    )
                    first, second = distances[slot, at], distances[other, other_at]
                    if (first < 0.0) == (second < 0.0):
                        continue
                    part = first / (first - second)
                    x += di + part * (axis == 0)
                    y += dj + part * (axis == 1)
                    z += dk + part * (axis == 2)
                    crossings += 1
            vertices[n, 0] = (coordinates[b, 0] * 8 + i + x / crossings) * voxel_m
            vertices[n, 1] = (coordinates[b, 1] * 8 + j + y / crossings) * voxel_m
            vertices[n, 2] = (coordinates[b, 2] * 8 + k + z / crossings) * voxel_m
            variance = color_weight = 0.0
            fewest_views = 65535
            for corner in range(8):
                slot, at = _at(around, b, i + (corner >> 2), j + ((corner >> 1) & 1), k + (corner & 1))
                weight, m = weights[slot, at], views[slot, at]
                stated_variance = 1.0 / weight
                scatter = scatters[slot, at] / (weight * (m - 1)) if m > 1 else 0.0
                variance += max(stated_variance, scatter) / 8.0
                fewest_views = min(fewest_views, m)
                for channel in range(3):
                    vertices[n, 3 + channel] += voxel_colors[slot, at, 3] * voxel_colors[slot, at, channel]
                color_weight += voxel_colors[slot, at, 3]
            if color_weight > 0.0:
                for channel in range(3):
                    vertices[n, 3 + channel] /= color_weight
            vertices[n, 6] = math.sqrt(variance)
            vertices[n, 7] = fewest_views
    return vertices


@njit(cache=True, error_model="numpy")
def surface_triangles(around: IntArray, distances: Float32Array, cells: IntArray) -> IntArray:
    """Return two triangles for each edge of the grid that the surface crosses between four numbered cells."""
    total = 0
    triangles = np.zeros((0, 3), np.int64)
    for is_written in (False, True):
        if is_written:
            triangles = np.zeros((total, 3), np.int64)
        total = 0
        for b in range(len(around)):
            for v in range(512):
                i, j, k = v >> 6, (v >> 3) & 7, v & 7
                for axis in range(3):
                    other, at = _at(around, b, i + (axis == 0), j + (axis == 1), k + (axis == 2))
                    if other < 0:
                        continue
                    first, second = distances[b, v] < 0.0, distances[other, at] < 0.0
                    if first == second:
                        continue
                    corners = (0, 0, 0, 0)
                    for side in range(4):
                        # Around the axis counter-clockwise: both before, next, both at, previous.
                        p, q = int(side < 1 or side > 2), int(side < 2)
                        di, dj, dk = (0, p, q) if axis == 0 else (q, 0, p) if axis == 1 else (p, q, 0)
                        slot, cell = _at(around, b, i - di, j - dj, k - dk)
                        number = cells[slot, cell] if slot >= 0 else -1
                        if side == 0:
                            corners = (number, corners[1], corners[2], corners[3])
                        elif side == 1:
                            corners = (corners[0], number, corners[2], corners[3])
                        elif side == 2:
                            corners = (corners[0], corners[1], number, corners[3])
                        else:
                            corners = (corners[0], corners[1], corners[2], number)
                    if min(corners) < 0:
                        continue
                    if is_written:
                        after, before = (corners[1], corners[3]) if first else (corners[3], corners[1])
                        triangles[total] = (corners[0], after, corners[2])
                        triangles[total + 1] = (corners[0], corners[2], before)
                    total += 2
    return triangles
