# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motions of the whole problem: similarity transforms about a centre.

A motion is a tangent vector ``(7,)``: translation x y z, rotation rx ry rz, logarithm of the scale. A finite
motion is a similarity transform ``(4, 4)`` of offsets from the centre.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3

#: Singular values below this ratio to the largest one are rounding noise.
ROUNDING = 1e-9


def position_derivatives(offsets: FloatArray) -> FloatArray:
    """Return the derivatives ``(n, 3, 7)`` with respect to a motion of positions at offsets ``(n, 3)`` from
    the centre.
    """
    return np.concatenate(
        [np.tile(np.eye(3), (len(offsets), 1, 1)), -se3.skew(offsets), offsets[:, :, None]], axis=2
    )


def pose_derivatives(offsets: FloatArray) -> FloatArray:
    """Return the derivatives ``(6n, 7)`` with respect to a motion of poses at offsets ``(n, 3)`` from the
    centre.
    """
    rotations = np.tile(np.eye(7)[3:6], (len(offsets), 1, 1))
    return np.concatenate([position_derivatives(offsets), rotations], axis=1).reshape(-1, 7)


def null_motions(rows: FloatArray) -> FloatArray:
    """Return an orthonormal basis ``(k, 7)`` of the null space of rows ``(n, 7)`` of norms about 1."""
    # The seven zero rows make V a square (7, 7) matrix for fewer than seven rows.
    _, values, V = np.linalg.svd(np.concatenate([np.zeros((7, 7)), rows]), full_matrices=False)
    return np.asarray(V[values <= ROUNDING * max(1.0, values[0])])


def exp_similarity(motion: FloatArray) -> FloatArray:
    """Return the similarity transform ``(4, 4)`` of a motion ``(7,)``.

    A motion that rotates by more than 1 rad or scales by more than a factor of e is shortened to that limit.
    """
    motion = motion / max(1.0, float(np.abs(motion[3:]).max()))
    generator = np.zeros((4, 4))
    generator[:3] = np.column_stack([se3.skew(motion[3:6]) + motion[6] * np.eye(3), motion[:3]])
    return np.asarray(expm(generator))


def rotation_of(similarity: FloatArray) -> FloatArray:
    """Return the rotation ``(3, 3)`` of a similarity transform."""
    return np.asarray(similarity[:3, :3] / np.cbrt(np.linalg.det(similarity[:3, :3])))


def transform_offsets(similarity: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return offsets ``(n, 3)`` from the centre after a similarity transform."""
    return np.asarray(offsets @ similarity[:3, :3].T + similarity[:3, 3])
