# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of the guesses from which a sweep is registered, by the support of the map."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration import _kernels, _voxel_table
from cdff_core.dfns.scan_to_map_registration._voxel_map import VoxelMap

#: Maximum number of points with which the support of guesses is compared.
_SUPPORT_POINTS = 2000
#: Maximum number of guesses that are registered, their minimum support relative to the best guess, and the
#: minimum distance between them, metres or radians.
_MAX_GUESSES, _MIN_SUPPORT_RATIO = 3, 0.7
_MIN_DISTANCE_M, _MIN_ANGLE_RAD = 1.0, 0.25


def best_guesses(
    local_map: VoxelMap, points: FloatArray, point_times: FloatArray, poses: FloatArray, motions: FloatArray
) -> list[int]:
    """Return the indices of the poses with the largest support, best first, with some distance between them.

    Parameters
    ----------
    points, point_times : ndarray, shapes (n, 3) and (n,)
        Points of the sweep and their times.
    poses, motions : ndarray, shapes (m, 4, 4) and (m, 6)
        T_map_sensor, and the motion during the sweep at each of them.

    Notes
    -----
    The support is computed with large voxels and a wide kernel.
    """
    level = min(1, len(local_map.tables) - 1)
    edge_m = local_map.voxel_m * (1 << level)
    sampled = _voxel_table.first_in_voxels(points, edge_m)
    sampled = sampled[:: 1 + len(sampled) // _SUPPORT_POINTS]
    support = _kernels.supports(
        local_map.tables,
        local_map.voxel_m,
        level,
        points[sampled],
        point_times[sampled],
        poses,
        motions,
        edge_m,
    )
    return _best_distinct(poses, support)


def _best_distinct(poses: FloatArray, support: FloatArray) -> list[int]:
    """Return the indices of the poses with the largest support that are not close to a better one."""
    selected_rows: list[int] = []
    for i in np.argsort(-support, kind="stable"):
        if support[i] < _MIN_SUPPORT_RATIO * support.max():
            break
        E = se3.inverse(poses[i]) @ poses[selected_rows]
        distance_m = np.linalg.norm(E[:, :3, 3], axis=1)
        angle_rad = np.linalg.norm(se3.log_so3(E[:, :3, :3]), axis=1)
        if np.all((distance_m > _MIN_DISTANCE_M) | (angle_rad > _MIN_ANGLE_RAD)):
            selected_rows.append(int(i))
        if len(selected_rows) == _MAX_GUESSES:
            break
    return selected_rows
