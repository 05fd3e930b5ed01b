# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motions of everything as one: x y z rx ry rz and the logarithm of the size, about a centre."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from cdff_common.geometry import se3

Float = NDArray[np.float64]
#: Share of the largest below which a singular value is rounding.
ROUNDING = 1e-9


def moved_places(offsets: Float) -> Float:
    """How places at offsets ``(n, 3)`` from the centre change ``(n, 3, 7)`` with each motion."""
    return np.concatenate([np.tile(np.eye(3), (len(offsets), 1, 1)), -se3.skew(offsets), offsets[:, :, None]], axis=2)


def moved_poses(offsets: Float) -> Float:
    """How poses x y z rx ry rz at offsets ``(n, 3)`` from the centre change ``(6n, 7)`` with each motion."""
    turned = np.tile(np.eye(7)[3:6], (len(offsets), 1, 1))
    return np.concatenate([moved_places(offsets), turned], axis=1).reshape(-1, 7)


def unheld(rows: Float) -> Float:
    """Motions ``(k, 7)``, orthonormal, for which rows ``(n, 7)`` of a size of about 1 are 0."""
    _, values, V = np.linalg.svd(np.concatenate([np.zeros((7, 7)), rows]), full_matrices=False)  # V is (7, 7)
    return np.asarray(V[values <= ROUNDING * max(1.0, values[0])])


def similarity(motion: Float) -> Float:
    """The finite motion ``(4, 4)`` of a motion ``(7,)``, shortened where it turns or grows by more than 1."""
    motion = motion / max(1.0, float(np.abs(motion[3:]).max()))
    generator = np.zeros((4, 4))
    generator[:3] = np.column_stack([se3.skew(motion[3:6]) + motion[6] * np.eye(3), motion[:3]])
    return np.asarray(expm(generator))


def turn(whole: Float) -> Float:
    """Rotation ``(3, 3)`` of a finite motion."""
    return np.asarray(whole[:3, :3] / np.cbrt(np.linalg.det(whole[:3, :3])))


def placed(whole: Float, offsets: Float) -> Float:
    """Offsets ``(n, 3)`` from the centre after a finite motion."""
    return np.asarray(offsets @ whole[:3, :3].T + whole[:3, 3])
