# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transforms and covariances as columns (little-endian float64, row-major) and as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform


def pack(T: UncertainTransform) -> dict[str, bytes | None]:
    """Return the columns ``matrix`` and ``covariance`` of a transform."""
    covariance = None if T.covariance is None else T.covariance.astype("<f8").tobytes()
    return {"matrix": T.matrix.astype("<f8").tobytes(), "covariance": covariance}


def unpack(matrix: bytes, covariance: bytes | None) -> UncertainTransform:
    """Return the transform of two columns; the inverse of ``pack``."""
    return UncertainTransform(
        np.frombuffer(matrix, "<f8").reshape(4, 4),
        None if covariance is None else np.frombuffer(covariance, "<f8").reshape(6, 6),
    )


def to_lists(T: UncertainTransform) -> dict[str, Any]:
    """Return the rows of the matrix as ``T``, and those of the covariance or None, as plain data."""
    return {"T": T.matrix.tolist(), "covariance": None if T.covariance is None else T.covariance.tolist()}
