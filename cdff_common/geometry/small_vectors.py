# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products of three-vectors in compiled loops, as scalars: small arrays would be written to memory."""

from __future__ import annotations

from numba import njit

from cdff_common.arrays import FloatArray


@njit(cache=True, inline="always")
def rotated(
    R: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the product of the upper left 3x3 block of a matrix and a vector; the transpose of the matrix
    rotates back.
    """
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@njit(cache=True, inline="always")
def transformed(
    T: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return a position in the parent frame of a transform (4, 4) from its coordinates in the child frame."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@njit(cache=True, inline="always")
def inverse_transformed(
    T: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return a position in the child frame of a transform (4, 4) from its coordinates in the parent frame."""
    return rotated(T.T, x - T[0, 3], y - T[1, 3], z - T[2, 3])


@njit(cache=True, inline="always")
def inverse_translation(T: FloatArray) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the origin of the parent frame of a transform (4, 4) in the child frame."""
    return rotated(T.T, -T[0, 3], -T[1, 3], -T[2, 3])


@njit(cache=True, inline="always")
def cross(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the vector product of two vectors."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
