# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points suppress later ones in a square around them, in cells of half its radius."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.features_extraction_2d._kernels import suppress


@pytest.mark.parametrize("radius", [0, 1, 2, 3, 4, 7])
@pytest.mark.parametrize("shape", [(17, 23), (23, 17)])
def test_a_point_remains_if_no_earlier_one_is_within_the_square(shape: tuple[int, int], radius: int) -> None:
    rng = np.random.default_rng(shape[0])
    rows, columns = rng.integers(0, shape[0], 60), rng.integers(0, shape[1], 60)
    cell = max(radius // 2, 1)
    cells = np.column_stack([rows, columns]) // cell
    kept_indices: list[int] = []
    for i, position in enumerate(cells):
        if all(np.abs(position - cells[j]).max() > radius // cell for j in kept_indices):
            kept_indices.append(i)
    np.testing.assert_array_equal(np.flatnonzero(suppress(columns, rows, shape, radius)), kept_indices)


def test_without_points_none_remains() -> None:
    none = np.zeros(0, np.int64)
    assert suppress(none, none, (10, 10), 4).shape == (0,)
