# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rotations that level the ground."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3


def rotations_to_z(normals: FloatArray) -> FloatArray:
    """Return the smallest rotations ``(n, 3, 3)`` that map unit normals ``(n, 3)`` to z."""
    axis = np.column_stack([normals[:, 1], -normals[:, 0], np.zeros(len(normals))])
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, normals[:, 2:])
    return se3.exp_so3(axis / np.maximum(sine, 1e-12) * angle)
