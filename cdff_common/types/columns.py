# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Columns of types with many rows: times in microseconds, poses as seven numbers, matrices as rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3

#: Largest deviation of the norm of a packed quaternion from 1; within it, the quaternion is normalised.
_NORM_TOLERANCE = 0.01


def stamps_us(stamps_ns: ArrayLike, where: str) -> NDArray[np.int64]:
    """Return times in microseconds of nanoseconds; raises InputError if one is not a multiple of 1000."""
    stamps = np.asarray(stamps_ns, dtype=np.int64).reshape(-1)
    if (stamps % 1000 != 0).any():
        raise InputError(f"{where}: expected multiples of 1000 ns (messages contain microseconds)")
    return stamps // 1000


def pack_poses(matrices: ArrayLike, where: str) -> NDArray[np.float64]:
    """Return ``(n, 7)`` x y z qx qy qz qw of transforms ``(n, 4, 4)``; raises InputError if one is not
    rigid.
    """
    T = np.asarray(matrices, dtype=np.float64).reshape(-1, 4, 4)
    invalid_rows = np.flatnonzero(~se3.are_transforms(T, tolerance=1e-5))
    if len(invalid_rows):
        raise InputError(
            f"{where} matrix {invalid_rows[0]}: {T[invalid_rows[0]].tolist()}, expected a rigid transform"
        )
    poses = np.empty((len(T), 7))
    poses[:, :3] = T[:, :3, 3]
    poses[:, 3:] = se3.quaternion_xyzw_from_matrix(T[:, :3, :3]) if len(T) else np.zeros((0, 4))
    return poses


def unpack_poses(poses: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """Return transforms ``(n, 4, 4)`` of ``(n, 7)``; raises InputError on quaternions far from unit
    length.
    """
    q_xyzw = poses[:, 3:]
    out = np.zeros((len(poses), 4, 4))
    if len(poses):
        norm = np.linalg.norm(q_xyzw, axis=1, keepdims=True)
        if not (np.abs(norm - 1.0) <= _NORM_TOLERANCE).all():
            raise InputError(f"{where}: expected unit quaternions x y z w")
        out[:, :3, :3] = se3.matrix_from_quaternion_xyzw(q_xyzw / norm)
    out[:, :3, 3] = poses[:, :3]
    out[:, 3, 3] = 1.0
    return out


def pack_squares(squares: ArrayLike | None, rows: int, side: int, where: str) -> NDArray[np.float64]:
    """Return ``(n, side * side)`` of matrices ``(n, side, side)``, no rows for None; raises InputError."""
    if squares is None:
        return np.zeros((0, side * side))
    array = np.asarray(squares, dtype=np.float64)
    if array.shape != (rows, side, side):
        raise InputError(f"{where}: shape {array.shape}, expected ({rows}, {side}, {side})")
    return array.reshape(rows, side * side)
