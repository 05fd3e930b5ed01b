# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""UncertainTransform: its arrays are copies that cannot change."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform


def test_the_arrays_are_copies_and_read_only() -> None:
    matrix, covariance = np.eye(4), np.eye(6)
    T = UncertainTransform(matrix, covariance)
    matrix[0, 3], covariance[0, 0] = 1.0, 2.0
    np.testing.assert_array_equal(T.matrix, np.eye(4))
    np.testing.assert_array_equal(T.covariance, np.eye(6))
    with pytest.raises(ValueError, match="read-only"):
        T.matrix[0, 3] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        T.covariance[0, 0] = 2.0  # type: ignore[index]
