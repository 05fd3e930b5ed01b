# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Validation of points and transforms, and downsampling by voxels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.geometry.voxels import voxel_for, voxel_means


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros(3), "shape"),
        (np.zeros((2, 4)), "shape"),
        ("text", "numbers"),
        ([[0, 0, np.nan]], "not finite"),
        (np.zeros((0, 3)), "at least 1"),
    ],
)
def test_invalid_points_are_refused_with_the_reason(points: Any, message: str) -> None:
    with pytest.raises(InputError, match=rf"cloud: .*{message}"):
        checked_points(points, "cloud")


def test_points_are_returned_as_contiguous_doubles() -> None:
    p = checked_points(np.zeros((3, 4), np.float32).T)
    assert (p.dtype, p.flags.c_contiguous) == (np.float64, True)


@pytest.mark.parametrize(
    "matrix", [np.eye(3), 2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan), "x"]
)
def test_a_non_rigid_matrix_is_refused(matrix: Any) -> None:
    with pytest.raises(InputError, match="T_a_b"):
        checked_transform(matrix, "T_a_b")


def test_the_centroid_survives_downsampling_to_one_voxel(rng: np.random.Generator) -> None:
    points = rng.normal(size=(1000, 3))
    np.testing.assert_allclose(voxel_means(points, 100.0), points.mean(axis=0)[None])


def test_few_or_coincident_points_need_no_downsampling(rng: np.random.Generator) -> None:
    assert voxel_for(rng.normal(size=(10, 3)), 10) == 0.0
    assert voxel_for(np.ones((100, 3)), 10) == 0.0
