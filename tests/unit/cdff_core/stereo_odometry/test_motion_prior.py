# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry with predictions from wheels and gyro, in a fast rotation and across a gap."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair, IMUSensors, Time, TransformWithCovariance
from cdff_core.stereo_odometry.camera_path import CameraPath
from cdff_core.stereo_odometry.motion_prior import MotionPrior
from tests.support.corridor import BASELINE_M, CAMERA, SHAPE, stereo_pair

STEP_NS = 500_000_000
#: The camera looks along the base's x axis; the gyro is rotated about all axes.
T_BASE_LEFT = se3.transform([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.5, 0.1, 1.0])
T_BASE_IMU = se3.transform(se3.exp_so3([0.4, -0.3, 0.5]), [0.1, 0.0, 0.0])
#: No descriptor match is accepted: points are tracked only by prediction.
NO_DESCRIPTORS = {"matching": {"max_ratio": 1e-6}}
SOURCES = [{"odometry"}, {"imu"}, {"imu", "odometry"}]


def path() -> list[np.ndarray]:
    """Return ``T_world_left``: forward, a rotation by 17 degrees to the right and 3 up, forward."""
    left = [np.eye(4)]
    for rotation in ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.05, 0.3, 0.0], [0.0, 0.0, 0.0]):
        left.append(left[-1] @ se3.transform(se3.exp_so3(rotation), [0.0, 0.0, 0.1]))
    return left


TRUTH = path()
#: Pairs before and after the rotation.
BEFORE, AFTER = 2, 3


def make_configured_dfpc(frames: FrameGraph, **config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(config, DfpcContext(robot="mana", frames=frames))
    return dfpc


def frames_with_mounts() -> FrameGraph:
    frames = FrameGraph()
    for child, T in (("mana/navcam_left", T_BASE_LEFT), ("mana/imu", T_BASE_IMU)):
        frames.set_static("mana/base", child, UncertainTransform.exact(T))
    return frames


def base_poses() -> list[np.ndarray]:
    return [T_BASE_LEFT @ T @ se3.inverse(T_BASE_LEFT) for T in TRUTH]


def odometry(i: int, T: np.ndarray) -> Sample:
    pose: Any = TransformWithCovariance.from_transform(
        UncertainTransform(T, np.eye(6)), parent="mana/odom", child="mana/base", stamp_ns=i * STEP_NS
    )
    return Sample("odometry", i * STEP_NS, i, pose)


def rates(i: int) -> list[Sample]:
    """Return angular rates between pair ``i`` and the next, at 20 Hz."""
    bases = base_poses()
    rotation = se3.log_so3((se3.inverse(bases[i]) @ bases[i + 1])[:3, :3]) / (STEP_NS * 1e-9)
    stamps = range(i * STEP_NS, (i + 1) * STEP_NS, 50_000_000)
    gyro = T_BASE_IMU[:3, :3].T @ rotation
    return [
        Sample("imu", t, k, IMUSensors(Time.from_ns(t), np.zeros(3), gyro, np.zeros(3)))
        for k, t in enumerate(stamps)
    ]


def step(dfpc: Dfpc, i: int, pair: FramePair | None = None) -> Output:
    sample = Sample("stereo", i * STEP_NS, i, pair or stereo_pair(TRUTH[i], i * STEP_NS), id=f"pair{i}")
    (output,) = dfpc.step(sample)
    return output


def drive(sources: set[str], frames: FrameGraph, **config: Any) -> list[Output]:
    dfpc, outputs = make_configured_dfpc(frames, **config), []
    for i in range(len(TRUTH)):
        if "odometry" in sources:
            assert list(dfpc.step(odometry(i, base_poses()[i]))) == []
        outputs.append(step(dfpc, i))
        if "imu" in sources and i + 1 < len(TRUTH):
            for sample in rates(i):
                dfpc.step(sample)
    return outputs


def test_a_fast_rotation_is_located_by_descriptors_without_a_prior() -> None:
    outputs = drive(set(), frames_with_mounts())
    assert Status.FAILED not in [o.quality.status for o in outputs]
    error = cov.pose_error(TRUTH[-1], outputs[-1].value.transform.matrix)
    assert np.linalg.norm(error[:3]) < 0.02
    assert np.linalg.norm(error[3:]) < 0.01


@pytest.mark.parametrize("sources", SOURCES)
def test_a_fast_rotation_is_tracked_with_a_prior_by_wheels_or_gyro(sources: set[str]) -> None:
    outputs = drive(sources, frames_with_mounts(), **NO_DESCRIPTORS)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(TRUTH)
    error = cov.pose_error(TRUTH[-1], outputs[-1].value.transform.matrix)
    assert np.linalg.norm(error[:3]) < 0.001
    assert np.linalg.norm(error[3:]) < 0.001


def test_a_fast_rotation_without_prior_and_descriptors_fails() -> None:
    outputs = drive(set(), frames_with_mounts(), **NO_DESCRIPTORS)
    assert [o.quality.status for o in outputs[AFTER:]] == [Status.FAILED, Status.FAILED]


@pytest.mark.parametrize("sources", SOURCES)
def test_the_prior_is_the_motion_of_the_camera(sources: set[str]) -> None:
    """With a gyro, the heading of the wheels, which is wrong by slip, has no effect."""
    gyro = Registry.default().make_dfn("gyro_integration")
    gyro.configure()
    prior = MotionPrior(gyro)
    prior.set_mounts(DfpcContext("mana", frames_with_mounts()), None, 0)
    if "odometry" in sources:
        first, second = base_poses()[BEFORE], base_poses()[AFTER]
        if "imu" in sources:
            second = second @ se3.transform(se3.exp_so3([0.0, 0.0, 0.2]), np.zeros(3))
        prior.add_pose(BEFORE * STEP_NS, UncertainTransform(first))
        prior.add_pose(AFTER * STEP_NS, UncertainTransform(second))
    if "imu" in sources:
        for sample in rates(BEFORE):
            prior.add_rate(sample.stamp_ns, sample.value.gyro)
    translation, rotation = prior.increment(BEFORE * STEP_NS, AFTER * STEP_NS)
    true = se3.inverse(TRUTH[BEFORE]) @ TRUTH[AFTER]
    assert rotation is not None
    np.testing.assert_allclose(rotation, true[:3, :3], atol=1e-9)
    if "odometry" in sources:
        assert translation is not None
        np.testing.assert_allclose(translation, true[:3, 3], atol=1e-9)
    else:
        assert translation is None


def test_without_the_mounts_there_is_no_prior() -> None:
    outputs = drive({"odometry", "imu"}, FrameGraph())
    assert all(o.quality.metrics.get("motion_prior", 0.0) == 0.0 for o in outputs)


@pytest.mark.parametrize("with_wheels", [True, False])
def test_a_rotation_in_the_dark_is_bridged_by_the_wheels(with_wheels: bool) -> None:
    dfpc, dark = make_configured_dfpc(frames_with_mounts(), **NO_DESCRIPTORS), np.zeros(SHAPE, np.uint8)
    statuses = []
    for i, T in enumerate(base_poses()):
        if with_wheels:
            dfpc.step(odometry(i, T))
        dark_pair = FramePair.from_images(
            dark, dark, baseline_m=BASELINE_M, camera_matrix=CAMERA, stamp_ns=i * STEP_NS
        )
        output = step(dfpc, i, dark_pair if i in (2, 3) else None)
        statuses.append(output.quality.status)
    assert statuses == [
        Status.OK,
        Status.OK,
        Status.FAILED,
        Status.FAILED,
        Status.OK if with_wheels else Status.FAILED,
    ]
    if with_wheels:
        assert np.linalg.norm(cov.pose_error(TRUTH[-1], output.value.transform.matrix)[:3]) < 0.001


def test_across_a_gap_the_prior_determines_pose_and_covariance() -> None:
    increment_of_wheels = (np.array([0.0, 0.0, 0.5]), se3.exp_so3([0.0, 0.3, 0.0]))
    sigmas_m, poses = [], []
    for increment in ((None, None), increment_of_wheels):
        camera_path = CameraPath(lambda _start, _end, increment=increment: increment)
        camera_path.add(0, UncertainTransform.identity())
        pose = camera_path.across_gap(2 * STEP_NS)
        poses.append(pose.matrix)
        sigmas_m.append(float(np.sqrt(pose.covariance[0, 0])))
    np.testing.assert_allclose(poses[1], se3.transform(increment_of_wheels[1], increment_of_wheels[0]))
    np.testing.assert_allclose(poses[0], np.eye(4))
    assert sigmas_m[1] == pytest.approx(0.02 + 0.2 * 0.5)
    assert sigmas_m[0] == pytest.approx(0.1)
