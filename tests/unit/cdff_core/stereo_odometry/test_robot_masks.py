# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Masks by images of a profile, by the URDF at the positions of its joints, and by ``--mask``."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.profile import load_profile
from cdff_common.types import FramePair, Joints, JointState
from cdff_core.stereo_odometry.robot_masks import RobotMasks
from cdff_dev.replay.wiring import with_masks
from tests.support.corridor import BASELINE_M, CAMERA, SHAPE

#: An arm of 1 m that points upwards, 2 m in front of the camera, whose y axis points down.
URDF = """<robot name="r"><link name="body"/><link name="arm">
<collision><origin xyz="0 -0.5 0"/><geometry><box size="0.2 1 0.2"/></geometry></collision></link>
<joint name="shoulder" type="continuous"><parent link="body"/><child link="arm"/>
<origin xyz="0 0 2"/><axis xyz="0 0 1"/></joint></robot>"""
PROFILE = """
name: masked
robots:
  - id: mana
    urdf: {urdf}
    sensors:
      navcam:
        kind: {kind}
        frame: mana/navcam_left
        streams: {{pair: FramePair}}
        mask: {mask}
"""


def pair() -> FramePair:
    image = np.zeros(SHAPE, np.uint8)
    return FramePair.from_images(
        image, image, baseline_m=BASELINE_M, camera_matrix=CAMERA, stamp_ns=0, sensor="mana/navcam_left"
    )


def context() -> DfpcContext:
    frames = FrameGraph()
    frames.set_static(
        "mana/base", "mana/navcam_left", UncertainTransform.exact(se3.transform(np.eye(3), [0, 0, 0]))
    )
    sensors = {"navcam": {"kind": "stereo_camera", "frame": "mana/navcam_left", "mask": "urdf"}}
    return DfpcContext("mana", frames, sensors=sensors, urdf=URDF)


def write_profile(folder: Path, mask: str, kind: str = "stereo_camera", urdf: str = "''") -> Path:
    path = folder / "masked.yaml"
    path.write_text(PROFILE.format(mask=mask, kind=kind, urdf=urdf), encoding="utf-8")
    return path


def test_the_arm_of_the_urdf_is_masked_in_both_images_at_its_disparity() -> None:
    left, right = RobotMasks(context()).of_pair(pair())
    assert left is not None
    assert right is not None
    centres = [np.nonzero(~mask)[1].mean() for mask in (left, right)]
    assert centres[0] == pytest.approx(CAMERA[0, 2], abs=1.0)
    assert centres[0] - centres[1] == pytest.approx(CAMERA[0, 0] * BASELINE_M / 1.95, abs=1.5)
    assert left[150:].all()  # the arm points upwards
    assert 0.05 < 1.0 - left.mean() < 0.25


def test_the_mask_follows_the_joints() -> None:
    masks = RobotMasks(context())
    masks.set_joints(Joints(names=("shoulder",), elements=(JointState(position=np.pi),)))
    left, _ = masks.of_pair(pair())
    assert left is not None
    assert left[:90].all()
    assert not left[130, 160]
    with pytest.raises(InputError, match="elbow"):
        masks.set_joints(Joints(names=("elbow",), elements=(JointState(),)))


def test_a_profile_has_its_mask_image_next_to_it(tmp_path: Path) -> None:
    image = np.full(SHAPE, 255, np.uint8)
    image[:, :100] = 0
    cv2.imwrite(str(tmp_path / "deck.png"), image)
    robot = load_profile(write_profile(tmp_path, "deck.png")).robots[0]
    sensors = {name: sensor.model_dump() for name, sensor in robot.sensors.items()}
    left, right = RobotMasks(DfpcContext("mana", sensors=sensors)).of_pair(pair())
    assert left is not None
    assert right is None
    assert not left[:, :107].any()  # with the half width of a patch
    assert left[:, 109:].all()


@pytest.mark.parametrize(
    ("mask", "kind", "fault"),
    [
        ("absent.png", "stereo_camera", "absent.png"),
        ("urdf", "stereo_camera", "no URDF"),
        ("deck.png", "lidar", "expected a stereo camera"),
        ("deck.png\n        mask_right: urdf", "stereo_camera", "mask_right: expected an image"),
    ],
)
def test_wrong_masks_of_a_profile_are_refused(tmp_path: Path, mask: str, kind: str, fault: str) -> None:
    with pytest.raises(ConfigurationError, match=fault):
        load_profile(write_profile(tmp_path, mask, kind))


def test_masks_of_the_command_line_are_those_of_the_only_stereo_camera(tmp_path: Path) -> None:
    for name in ("left", "right"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full(SHAPE, 255 * (name == "left"), np.uint8))
    files = [str(tmp_path / f"{name}.png") for name in ("left", "right")]
    left, right = RobotMasks(with_masks(DfpcContext("mana"), files)).of_pair(pair())
    assert left is not None
    assert left.all()
    assert right is not None
    assert not right.any()
    with pytest.raises(InputError, match="--mask: 3 files"):
        with_masks(DfpcContext("mana"), [*files, files[0]])
