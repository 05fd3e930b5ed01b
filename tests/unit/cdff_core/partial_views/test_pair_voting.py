# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Local frames of the point pairs."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.partial_views.pair_voting import _aligning_rotation


@pytest.mark.parametrize(
    "normal", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, -1), (2, 1, -3), (5, 1, 2), (0.7, 0.7, 0.1)]
)
def test_the_aligning_rotation_maps_a_normal_to_x(normal: tuple[float, float, float]) -> None:
    n = np.array(normal, dtype=np.float64) / np.linalg.norm(normal)
    R = _aligning_rotation(n)
    np.testing.assert_allclose(R @ n, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
