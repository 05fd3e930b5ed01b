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
def cross(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the vector product of two vectors."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
