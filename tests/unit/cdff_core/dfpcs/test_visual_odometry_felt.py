# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wheels and gyro tell visual odometry where to look, and how far it came while it saw nothing."""

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
from cdff_core.dfpcs.visual_odometry_sparse._state import Path
from tests.corridor import BASELINE_M, CAMERA, SHAPE, stereo_pair

STEP_NS = 500_000_000
#: The camera looks along the base's x axis, half a metre ahead and a metre above it; the gyro sits askew to all axes.
T_BASE_LEFT = se3.transform([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.5, 0.1, 1.0])
T_BASE_IMU = se3.transform(se3.exp_so3([0.4, -0.3, 0.5]), [0.1, 0.0, 0.0])
#: Of the descriptors nothing passes: what is found then was predicted.
NO_DESCRIPTORS = {"matching": {"max_ratio": 1e-6}}
SOURCES = [{"odometry"}, {"imu"}, {"imu", "odometry"}]


def way() -> list[np.ndarray]:
    """``T_world_left``: ahead, then a turn by 17 degrees to the right and 3 up between two pairs, then ahead."""
    left = [np.eye(4)]
    for turn in ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.05, 0.3, 0.0], [0.0, 0.0, 0.0]):
        left.append(left[-1] @ se3.transform(se3.exp_so3(turn), [0.0, 0.0, 0.1]))
    return left


TRUTH = way()
#: The turn: between these two pairs.
BEFORE, AFTER = 2, 3


def made(frames: FrameGraph, **config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(config, DfpcContext(robot="mana", frames=frames))
    return dfpc


def mounted() -> FrameGraph:
    frames = FrameGraph()
    for child, T in (("mana/navcam_left", T_BASE_LEFT), ("mana/imu", T_BASE_IMU)):
        frames.set_static("mana/base", child, UncertainTransform(T, np.zeros((6, 6))))
    return frames


def base_poses() -> list[np.ndarray]:
    return [T_BASE_LEFT @ T @ se3.inverse(T_BASE_LEFT) for T in TRUTH]


def odometry(i: int, T: np.ndarray) -> Sample:
    pose: Any = TransformWithCovariance.from_transform(
        UncertainTransform(T, np.eye(6)), parent="mana/odom", child="mana/base", stamp_ns=i * STEP_NS
    )
    return Sample("odometry", i * STEP_NS, i, pose)


def rates(i: int) -> list[Sample]:
    """Angular rates between pair ``i`` and the next, at 20 Hz."""
    bases = base_poses()
    turn = se3.log_so3((se3.inverse(bases[i]) @ bases[i + 1])[:3, :3]) / (STEP_NS * 1e-9)
    stamps = range(i * STEP_NS, (i + 1) * STEP_NS, 50_000_000)
    gyro = T_BASE_IMU[:3, :3].T @ turn
    return [
        Sample("imu", t, k, IMUSensors(Time.from_ns(t), np.zeros(3), gyro, np.zeros(3))) for k, t in enumerate(stamps)
    ]


def seen(dfpc: Dfpc, i: int, pair: FramePair | None = None) -> Output:
    sample = Sample("stereo", i * STEP_NS, i, pair or stereo_pair(TRUTH[i], i * STEP_NS), id=f"pair{i}")
    (output,) = dfpc.step(sample)
    return output


def driven(sources: set[str], frames: FrameGraph, **config: Any) -> list[Output]:
    dfpc, outputs = made(frames, **config), []
    for i in range(len(TRUTH)):
        if "odometry" in sources:
            assert list(dfpc.step(odometry(i, base_poses()[i]))) == []
        outputs.append(seen(dfpc, i))
        if "imu" in sources and i + 1 < len(TRUTH):
            for sample in rates(i):
                dfpc.step(sample)
    return outputs


def test_a_fast_turn_is_found_by_descriptors_where_nothing_was_felt() -> None:
    outputs = driven(set(), mounted())
    assert Status.FAILED not in [o.quality.status for o in outputs]
    error = cov.pose_error(TRUTH[-1], outputs[-1].value.transform.matrix)
    assert np.linalg.norm(error[:3]) < 0.02
    assert np.linalg.norm(error[3:]) < 0.01


@pytest.mark.parametrize("sources", SOURCES)
def test_a_fast_turn_is_followed_with_what_wheels_or_gyro_felt(sources: set[str]) -> None:
    outputs = driven(sources, mounted(), **NO_DESCRIPTORS)
    assert [o.quality.status for o in outputs] == [Status.OK] * len(TRUTH)
    error = cov.pose_error(TRUTH[-1], outputs[-1].value.transform.matrix)
    assert np.linalg.norm(error[:3]) < 0.001
    assert np.linalg.norm(error[3:]) < 0.001


def test_neither_felt_nor_described_a_fast_turn_is_lost_and_said_to_be() -> None:
    outputs = driven(set(), mounted(), **NO_DESCRIPTORS)
    assert [o.quality.status for o in outputs[AFTER:]] == [Status.FAILED, Status.FAILED]


@pytest.mark.parametrize("sources", SOURCES)
def test_what_is_felt_of_a_turn_is_the_motion_of_the_camera_and_not_of_base_or_gyro(sources: set[str]) -> None:
    """Of wheels beside a gyro the heading is not believed, as on slipping ground: the lever arm turns by the gyro."""
    dfpc = made(mounted())
    seen(dfpc, 0)  # learns the mounts
    if "odometry" in sources:
        first, second = base_poses()[BEFORE], base_poses()[AFTER]
        if "imu" in sources:
            second = second @ se3.transform(se3.exp_so3([0.0, 0.0, 0.2]), np.zeros(3))
        dfpc.step(odometry(BEFORE, first))
        dfpc.step(odometry(AFTER, second))
    if "imu" in sources:
        for sample in rates(BEFORE):
            dfpc.step(sample)
    translation, rotation = dfpc._felt.increment(BEFORE * STEP_NS, AFTER * STEP_NS)
    true = se3.inverse(TRUTH[BEFORE]) @ TRUTH[AFTER]
    assert rotation is not None
    np.testing.assert_allclose(rotation, true[:3, :3], atol=1e-9)
    if "odometry" in sources:
        assert translation is not None
        np.testing.assert_allclose(translation, true[:3, 3], atol=1e-9)
    else:
        assert translation is None


def test_without_the_mounts_nothing_is_felt() -> None:
    outputs = driven({"odometry", "imu"}, FrameGraph())
    assert all(o.quality.metrics.get("felt", 0.0) == 0.0 for o in outputs)


@pytest.mark.parametrize("felt", [True, False])
def test_a_turn_in_the_dark_is_bridged_by_the_wheels_alone(felt: bool) -> None:
    dfpc, dark = made(mounted(), **NO_DESCRIPTORS), np.zeros(SHAPE, np.uint8)
    statuses = []
    for i, T in enumerate(base_poses()):
        if felt:
            dfpc.step(odometry(i, T))
        unseen = FramePair.from_images(dark, dark, baseline_m=BASELINE_M, camera_matrix=CAMERA, stamp_ns=i * STEP_NS)
        output = seen(dfpc, i, unseen if i in (2, 3) else None)
        statuses.append(output.quality.status)
    assert statuses == [Status.OK, Status.OK, Status.FAILED, Status.FAILED, Status.OK if felt else Status.FAILED]
    if felt:
        assert np.linalg.norm(cov.pose_error(TRUTH[-1], output.value.transform.matrix)[:3]) < 0.001


def test_across_a_gap_what_was_felt_places_the_camera() -> None:
    felt = (np.array([0.0, 0.0, 0.5]), se3.exp_so3([0.0, 0.3, 0.0]))
    sigmas_m, poses = [], []
    for increment in ((None, None), felt):
        path = Path(10, lambda _begin, _end, increment=increment: increment)
        path.measured(0, UncertainTransform.identity())
        pose = path.across_gap(2 * STEP_NS)
        poses.append(pose.matrix)
        sigmas_m.append(float(np.sqrt(pose.covariance[0, 0])))
    np.testing.assert_allclose(poses[1], se3.transform(felt[1], felt[0]))
    np.testing.assert_allclose(poses[0], np.eye(4))
    assert sigmas_m[1] == pytest.approx(0.02 + 0.2 * 0.5)
    assert sigmas_m[0] == pytest.approx(0.1)
