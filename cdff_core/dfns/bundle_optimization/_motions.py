# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motions of the whole problem: x y z rx ry rz and the logarithm of the scale, about a centre."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3

#: Ratio to the largest singular value below which a singular value is rounding noise.
ROUNDING = 1e-9


def position_derivatives(offsets: FloatArray) -> FloatArray:
    """Return derivatives ``(n, 3, 7)`` of positions at offsets ``(n, 3)`` from the centre by motions."""
    return np.concatenate(
        [np.tile(np.eye(3), (len(offsets), 1, 1)), -se3.skew(offsets), offsets[:, :, None]], axis=2
    )


def pose_derivatives(offsets: FloatArray) -> FloatArray:
    """Return derivatives ``(6n, 7)`` of poses at offsets ``(n, 3)`` from the centre by motions."""
    turned = np.tile(np.eye(7)[3:6], (len(offsets), 1, 1))
    return np.concatenate([position_derivatives(offsets), turned], axis=1).reshape(-1, 7)


def null_motions(rows: FloatArray) -> FloatArray:
    """Return orthonormal motions ``(k, 7)`` in the null space of rows ``(n, 7)`` of norms of about 1."""
    _, values, V = np.linalg.svd(np.concatenate([np.zeros((7, 7)), rows]), full_matrices=False)  # V is (7, 7)
    return np.asarray(V[values <= ROUNDING * max(1.0, values[0])])


def similarity(motion: FloatArray) -> FloatArray:
    """Return the finite motion ``(4, 4)`` of a tangent ``(7,)``, shortened to rotation and scale of 1."""
    motion = motion / max(1.0, float(np.abs(motion[3:]).max()))
    generator = np.zeros((4, 4))
    generator[:3] = np.column_stack([se3.skew(motion[3:6]) + motion[6] * np.eye(3), motion[:3]])
    return np.asarray(expm(generator))


def rotation_of(whole: FloatArray) -> FloatArray:
    """Return the rotation ``(3, 3)`` of a finite motion."""
    return np.asarray(whole[:3, :3] / np.cbrt(np.linalg.det(whole[:3, :3])))


def transformed(whole: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return offsets ``(n, 3)`` from the centre after a finite motion."""
    return np.asarray(offsets @ whole[:3, :3].T + whole[:3, 3])
