# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude of a sensor between measured attitudes, and the poses that it rotates."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import TransformWithCovariance
from cdff_core.rigid_body.sensor_attitude import SensorAttitude

RATE = np.radians([0.0, 0.3, 0.4])
MOUNT = se3.transform(se3.exp_so3([0.1, 0.5, -0.2]), np.array([0.3, 0.0, 0.1]))
SIGMA_RAD = 1e-4


def _rotation(t_s: float) -> np.ndarray:
    return np.asarray(se3.exp_so3(RATE * t_s))


def _sample(t_s: float, child: str = "servicer/base", parent: str = "inertial") -> Sample:
    stamp_ns, covariance = round(1e9 * t_s), 1e12 * np.eye(6)
    covariance[3:, 3:] = SIGMA_RAD**2 * np.eye(3)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(se3.transform(_rotation(t_s), np.zeros(3)), covariance),
        parent=parent,
        child=child,
        stamp_ns=stamp_ns,
    )
    return Sample("attitude", stamp_ns, 0, value, id=f"a{t_s}")


def _attitudes(times_s: list[float]) -> SensorAttitude:
    frames = FrameGraph()
    frames.set_static("servicer/base", "servicer/lidar", UncertainTransform(MOUNT))
    attitude = SensorAttitude(frames, 2.0)
    for t_s in times_s:
        attitude.give(_sample(t_s))
    return attitude


@pytest.mark.parametrize("t_s", [4.0, 4.7, 9.5])
def test_the_attitude_of_the_sensor_contains_its_mount_at_any_time(t_s: float) -> None:
    found = _attitudes([0.0, 2.0, 4.0, 6.0, 8.0]).at(round(1e9 * t_s), "servicer/lidar")
    np.testing.assert_allclose(found.R, _rotation(t_s) @ MOUNT[:3, :3], atol=1e-9)
    assert (found.frame, found.id) == ("inertial", "a8.0")
    is_measured = t_s == 4.0
    sigma_rad = float(np.sqrt(found.covariance[0, 0]))
    assert sigma_rad == pytest.approx(SIGMA_RAD) if is_measured else sigma_rad > 2.0 * SIGMA_RAD


@pytest.mark.parametrize(
    ("times_s", "t_s", "reason"),
    [
        ([], 0.0, "attitude_missing"),
        ([0.0, 2.0], 4.5, "attitude_missing:2.5s"),
        ([0.0, 2.0, 10.0], 6.0, "attitude_missing:4s"),
        ([2.0], 3.0, "attitude_missing:1s"),  # one attitude shows no rate
        ([2.0, 4.0], 1.5, "attitude_missing:0.5s"),
    ],
)
def test_times_without_a_near_attitude_are_refused(times_s: list[float], t_s: float, reason: str) -> None:
    with pytest.raises(RefusedError) as error:
        _attitudes(times_s).at(round(1e9 * t_s), "servicer/lidar")
    assert list(error.value.reasons) == [reason]


def test_a_frame_that_is_not_connected_is_refused() -> None:
    with pytest.raises(RefusedError, match="its mount on servicer/base is unknown"):
        _attitudes([0.0]).at(0, "other/lidar")


def test_attitudes_of_other_frames_or_in_the_wrong_order_are_refused() -> None:
    attitude = _attitudes([0.0, 2.0])
    with pytest.raises(InputError, match=r"frames \('inertial', 'other/base'\)"):
        attitude.give(_sample(4.0, child="other/base"))
    with pytest.raises(InputError, match="expected after 2000000000 ns"):
        attitude.give(_sample(1.0))


def test_the_error_of_the_attitude_is_in_the_covariance_of_a_rotated_pose() -> None:
    found = _attitudes([0.0, 2.0]).at(0, "servicer/lidar")
    pose = se3.transform(se3.exp_so3([0.3, 0.1, 0.0]), np.array([0.0, 0.0, 10.0]))
    rotated = found.rotated(UncertainTransform(pose, 1e-12 * np.eye(6)))
    np.testing.assert_allclose(rotated.matrix[:3, :3], found.R @ pose[:3, :3], atol=1e-12)
    line = rotated.matrix[:3, 3] / 10.0
    assert line @ rotated.covariance[:3, :3] @ line == pytest.approx(
        0.0, abs=1e-10
    )  # along the line of sight
    assert np.trace(rotated.covariance[:3, :3]) == pytest.approx(2.0 * (10.0 * SIGMA_RAD) ** 2, rel=1e-3)
    assert found.rotated(UncertainTransform(pose)).covariance is None
