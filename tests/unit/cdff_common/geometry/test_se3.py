# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SO(3) and SE(3): inverses, round trips and conventions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cdff_common.errors import InputError
from cdff_common.geometry import se3

angles = arrays(np.float64, (3,), elements=st.floats(-1.8, 1.8))
twists = arrays(np.float64, (6,), elements=st.floats(-1.7, 1.7))


@given(angles)
def test_log_inverts_exp_of_a_rotation(phi: np.ndarray) -> None:
    assert np.allclose(se3.log_so3(se3.exp_so3(phi)), phi, atol=1e-9)


@given(twists)
def test_log_inverts_exp_of_a_transform(xi: np.ndarray) -> None:
    assert np.allclose(se3.log_se3(se3.exp_se3(xi)), xi, atol=1e-8)


@given(twists)
def test_a_transform_times_its_inverse_is_identity(xi: np.ndarray) -> None:
    T = se3.exp_se3(xi)
    assert np.allclose(T @ se3.inverse(T), np.eye(4), atol=1e-12)


@given(angles)
def test_quaternion_round_trip_keeps_the_rotation_and_w_is_not_negative(phi: np.ndarray) -> None:
    R = se3.exp_so3(phi)
    q = se3.quaternion_xyzw_from_matrix(R)
    assert q[3] >= 0
    assert np.allclose(se3.matrix_from_quaternion_xyzw(q), R, atol=1e-12)


@given(angles)
def test_a_quaternion_and_its_negative_have_the_same_rotation_vector(phi: np.ndarray) -> None:
    q = se3.quaternion_xyzw_from_matrix(se3.exp_so3(phi))
    for quaternion in (q, -q):
        assert np.allclose(se3.rotation_vector_from_quaternion_xyzw(quaternion), phi, atol=1e-9)


def test_rotations_by_180_degrees_survive_the_quaternion() -> None:
    for axis in np.eye(3):
        R = se3.exp_so3(np.pi * axis)
        assert np.allclose(se3.matrix_from_quaternion_xyzw(se3.quaternion_xyzw_from_matrix(R)), R, atol=1e-12)
        assert np.isclose(se3.rotation_angle(R), np.pi)


def test_quaternions_are_x_y_z_w() -> None:
    q = [0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)]
    assert np.allclose(se3.matrix_from_quaternion_xyzw(q) @ [1, 0, 0], [0, 1, 0])


def test_a_zero_quaternion_is_refused() -> None:
    with pytest.raises(InputError, match="norm"):
        se3.matrix_from_quaternion_xyzw([0.0, 0.0, 0.0, 0.0])


def test_stacked_elements_give_the_same_result_as_single_ones(rng: np.random.Generator) -> None:
    xi = rng.normal(size=(5, 4, 6))
    stacked = se3.exp_se3(xi)
    assert np.allclose(stacked[3, 2], se3.exp_se3(xi[3, 2]))
    assert np.allclose(se3.log_se3(stacked), xi, atol=1e-8) or stacked.shape == (5, 4, 4, 4)


def test_T_a_b_maps_points_of_b_into_a() -> None:
    T_a_b = se3.transform(se3.exp_so3([0, 0, np.pi / 2]), [1.0, 0.0, 0.0])
    assert np.allclose(se3.transform_points(T_a_b, [[1.0, 0.0, 0.0]]), [[1.0, 1.0, 0.0]])


def test_the_nearest_rotation_of_a_reflection_is_a_rotation() -> None:
    R = se3.normalise_rotation(np.diag([1.0, 1.0, -1.0]))
    assert np.isclose(np.linalg.det(R), 1.0)
    assert not se3.is_transform(np.diag([1.0, 1.0, -1.0, 1.0]))


def test_matrices_whose_products_overflow_are_no_transforms_and_cause_no_warning() -> None:
    T = np.tile(np.eye(4), (3, 1, 1))
    T[0, :3, :3] *= 1e300
    T[1, 0, 1] = np.inf
    assert se3.are_transforms(T).tolist() == [False, False, True]


def test_the_tolerance_of_transforms_is_that_of_each_entry() -> None:
    T = np.tile(np.eye(4), (4, 1, 1))
    T[0, 0, 0] += 4e-5  # its square differs by 8e-5
    T[1, 0, 0] += 6e-5
    T[2, 3, 2] = 0.99e-4
    T[3, 3, 2] = 1.01e-4
    assert se3.are_transforms(T, 1e-4).tolist() == [True, False, True, False]


def test_many_transforms_are_checked_as_one_is(rng: np.random.Generator) -> None:
    T = se3.exp_se3(rng.normal(size=(12, 6)))
    T[0, 0, 0] += 1e-4
    T[1, 3, 3] = 2.0
    T[2, 0, 3] = np.nan
    T[3, :3, :3] *= -1.0
    T[4, 1, 1] = np.inf
    T[5] = 0.0
    expected = [se3.is_transform(matrix) for matrix in T]
    assert expected == [False] * 6 + [True] * 6
    assert se3.are_transforms(T).tolist() == expected
    assert se3.are_transforms(np.zeros((0, 4, 4))).tolist() == []
