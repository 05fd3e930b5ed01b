# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""True poses are compared in the frame of the estimate, if the log states its place on the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import FramePair, TransformWithCovariance
from cdff_dev.compare.trajectory.read import read_track
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.slam.true_poses import true_poses

T_BASE_CAMERA = se3.transform(se3.exp_so3(np.array([0.3, -1.2, 0.5])), np.array([0.1, 0.2, 0.3]))
T_WORLD_BASE = np.array(
    [
        se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.1 * k])), np.array([1.0 * k, 0.0, 0.0]))
        for k in range(3)
    ]
)


def write(path: Path, T_base_sensor: np.ndarray, *, as_stream: bool) -> Path:
    """Write true poses of the base; the place of the sensor is that of its images or a stream of its own."""
    mount = UncertainTransform(T_base_sensor)
    with LogWriter(path) as log:
        for k, T in enumerate(T_WORLD_BASE):
            stamp_ns = 1_000_000 * (k + 1)
            pose = TransformWithCovariance.from_transform(
                UncertainTransform(T), parent="mana/world", child="mana/base", stamp_ns=stamp_ns
            )
            log.write("/mana/truth.pose", pose, stamp_ns)
            pixels = np.zeros((4, 6), np.uint8)
            pair = FramePair.from_images(
                pixels,
                pixels,
                baseline_m=0.1,
                camera_matrix=np.diag([5.0, 5.0, 1.0]),
                stamp_ns=stamp_ns,
                sensor="mana/navcam_left",
                T_robot_sensor=None if as_stream else mount,
            )
            log.write("/mana/navcam.pair", pair, stamp_ns)
        if as_stream:
            place = TransformWithCovariance.from_transform(
                mount, parent="mana/base", child="mana/navcam_left", stamp_ns=1_000_000
            )
            log.write("/mana/navcam.mount", place, 1_000_000)
    return path


@pytest.mark.parametrize("as_stream", [False, True])
def test_true_poses_of_the_base_become_those_of_the_sensor(tmp_path: Path, as_stream: bool) -> None:
    with open_log(write(tmp_path / "run.msg", T_BASE_CAMERA, as_stream=as_stream)) as log:
        truth = true_poses(log, "mana/navcam_left")
        base_truth = true_poses(log, "mana/base")
    assert truth.track is not None
    assert base_truth.track is not None
    assert (truth.frame, base_truth.frame) == ("mana/navcam_left", "mana/base")
    np.testing.assert_allclose(truth.track.matrices, T_WORLD_BASE @ T_BASE_CAMERA, atol=1e-12)
    np.testing.assert_allclose(base_truth.track.matrices, T_WORLD_BASE, atol=1e-12)


def test_without_the_place_of_the_sensor_the_frame_of_the_true_poses_is_stated(tmp_path: Path) -> None:
    with open_log(write(tmp_path / "run.msg", T_BASE_CAMERA, as_stream=False)) as log:
        truth = true_poses(log, "mana/lidar")
    assert truth.frame == "mana/base"
    assert truth.track is not None


def test_a_log_without_true_poses_has_the_reason(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.msg") as writer:
        pose = TransformWithCovariance.from_transform(
            UncertainTransform(np.eye(4)), parent="a", child="b", stamp_ns=1000
        )
        writer.write("/mana/odometry.pose", pose, 1000)
    with open_log(tmp_path / "run.msg") as log:
        assert true_poses(log, "b").fault == "no true poses in the log"


def test_a_reference_can_be_that_of_a_chosen_frame(tmp_path: Path) -> None:
    path = write(tmp_path / "run.msg", T_BASE_CAMERA, as_stream=True)
    np.testing.assert_allclose(
        read_track(path, frame="mana/navcam_left").matrices, T_WORLD_BASE @ T_BASE_CAMERA, atol=1e-12
    )
    with pytest.raises(InputError, match="--ref-frame mana/lidar: its place in mana/base is not in the log"):
        read_track(path, frame="mana/lidar")
