# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transforms and covariances as columns: little-endian float64, row by row."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform


def pack(T: UncertainTransform) -> dict[str, bytes | None]:
    """Columns ``matrix`` and ``covariance`` of a transform."""
    covariance = None if T.covariance is None else T.covariance.astype("<f8").tobytes()
    return {"matrix": T.matrix.astype("<f8").tobytes(), "covariance": covariance}


def unpack(matrix: bytes, covariance: bytes | None) -> UncertainTransform:
    """Inverse of ``pack``."""
    return UncertainTransform(
        np.frombuffer(matrix, "<f8").reshape(4, 4),
        None if covariance is None else np.frombuffer(covariance, "<f8").reshape(6, 6),
    )
