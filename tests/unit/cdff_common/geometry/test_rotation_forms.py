# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses from named forms: the order of a quaternion and the units of angles cannot be confused."""

from __future__ import annotations

from types import SimpleNamespace as Ros

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.rotation_forms import matrix_from_rpy_deg, rpy_deg_from_matrix
from cdff_common.types import Pose


@pytest.mark.parametrize("seed", range(20))
def test_roll_pitch_yaw_are_those_of_scipy_about_fixed_axes(seed: int) -> None:
    rpy_deg = np.random.default_rng(seed).uniform([-180, -89, -180], [180, 89, 180])
    expected = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    np.testing.assert_allclose(matrix_from_rpy_deg(rpy_deg), expected, atol=1e-14)
    np.testing.assert_allclose(rpy_deg_from_matrix(expected), rpy_deg, atol=1e-9)


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0])
def test_a_vertical_x_axis_has_roll_zero_and_the_same_matrix(pitch_deg: float) -> None:
    R = matrix_from_rpy_deg([20.0, pitch_deg, 50.0])
    rpy_deg = rpy_deg_from_matrix(R)
    assert rpy_deg[0] == 0.0
    np.testing.assert_allclose(matrix_from_rpy_deg(rpy_deg), R, atol=1e-8)


def test_a_positive_pitch_lowers_the_x_axis() -> None:
    pose = Pose.from_xyz_rpy_deg([0, 0, 1], [0, 30, 0])
    assert (pose.matrix[:3, :3] @ [1, 0, 0])[2] == pytest.approx(-0.5)


def test_both_orders_of_a_quaternion_give_the_same_pose_if_they_are_named() -> None:
    x, y, z, w = Rotation.from_euler("z", 90, degrees=True).as_quat()
    first = Pose.from_quaternion([1, 2, 3], xyzw=[x, y, z, w])
    assert first == Pose.from_quaternion([1, 2, 3], wxyz=[w, x, y, z])
    np.testing.assert_allclose(first.matrix[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "either xyzw="),
        ({"xyzw": [0, 0, 0, 1], "wxyz": [1, 0, 0, 0]}, "either xyzw="),
        ({"xyzw": [0, 0, 0, 2]}, "norm is 2"),
        ({"wxyz": [0, 0, 90.0, 0]}, "quaternion wxyz .* norm is 90"),
        ({"xyzw": [0, 0, 1]}, "expected 4 finite numbers"),
        ({"xyzw": [0, 0, float("nan"), 1]}, "expected 4 finite numbers"),
    ],
)
def test_a_quaternion_that_is_ambiguous_or_not_of_unit_length_is_refused(
    arguments: dict[str, list[float]], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        UncertainTransform.from_quaternion([0, 0, 0], **arguments)


def test_standard_deviations_are_metres_and_degrees() -> None:
    T = UncertainTransform.from_xyz_rpy_deg([1, 0, 0], [0, 0, 0], sigma_m=0.02, sigma_deg=0.5)
    assert T.covariance is not None
    np.testing.assert_allclose(np.sqrt(np.diag(T.covariance)), [0.02] * 3 + [np.deg2rad(0.5)] * 3)
    with pytest.raises(InputError, match="sigma_deg=-1"):
        UncertainTransform.from_xyz_rpy_deg([1, 0, 0], [0, 0, 0], sigma_deg=-1)


def point(x: float, y: float, z: float) -> Ros:
    return Ros(x=x, y=y, z=z)


QUARTER = Ros(x=0.0, y=0.0, z=np.sqrt(0.5), w=np.sqrt(0.5))


@pytest.mark.parametrize(
    "message",
    [
        Ros(position=point(1, 2, 3), orientation=QUARTER),
        Ros(translation=point(1, 2, 3), rotation=QUARTER),
        Ros(header=None, transform=Ros(translation=point(1, 2, 3), rotation=QUARTER)),
        Ros(
            header=None,
            pose=Ros(pose=Ros(position=point(1, 2, 3), orientation=QUARTER), covariance=[0.0] * 36),
        ),
        {
            "position": {"x": 1, "y": 2, "z": 3},
            "orientation": {"x": 0, "y": 0, "z": np.sqrt(0.5), "w": np.sqrt(0.5)},
        },
    ],
)
def test_every_pose_of_ros_gives_the_same_transform(message: object) -> None:
    T = UncertainTransform.from_ros(message)
    np.testing.assert_allclose(T.apply([[1, 0, 0]]), [[1, 3, 3]], atol=1e-12)
    assert T.covariance is None
    assert Pose.from_ros(message).matrix == pytest.approx(T.matrix)


def test_the_covariance_of_ros_is_kept_and_an_unknown_one_is_none() -> None:
    covariance = np.diag([0.1, 0.2, 0.3, 0.01, 0.02, 0.03])
    pose = Ros(position=point(0, 0, 0), orientation=QUARTER)
    T = UncertainTransform.from_ros(Ros(pose=pose, covariance=covariance.ravel()))
    np.testing.assert_array_equal(T.covariance, covariance)
    assert UncertainTransform.from_ros(Ros(pose=pose, covariance=[-1.0] + [0.0] * 35)).covariance is None


def test_a_message_without_a_pose_is_refused_with_its_type() -> None:
    with pytest.raises(InputError, match="SimpleNamespace: expected a ROS message with position"):
        Pose.from_ros(Ros(twist=1))
