# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""URDF files: a tree of links and joints, or an error with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.geometry import se3
from cdff_common.geometry.urdf import read_urdf

ROVER = """<?xml version="1.0"?>
<robot name="rover">
  <link name="base_link"/><link name="Mast"/><link name="pan"/><link name="tilt"/><link name="arm"/>
  <joint name="tilt_joint" type="revolute">
    <parent link="pan"/><child link="tilt"/><origin xyz="0 0 0.1"/><axis xyz="0 2 0"/>
    <limit lower="-1.0" upper="0.5" effort="1" velocity="1"/>
  </joint>
  <joint name="pan_joint" type="continuous"><parent link="Mast"/><child link="pan"/><axis xyz="0 0 1"/></joint>
  <joint name="mast_joint" type="fixed">
    <parent link="base_link"/><child link="Mast"/><origin xyz="0.3 0 0.8" rpy="0 0 1.5707963267948966"/>
  </joint>
  <joint name="arm_joint" type="prismatic">
    <parent link="base_link"/><child link="arm"/><limit lower="0" upper="0.4" effort="1" velocity="1"/>
    <mimic joint="pan_joint" multiplier="0.1" offset="0.2"/>
  </joint>
</robot>"""


def test_joints_are_listed_from_the_root_with_their_frames() -> None:
    model = read_urdf(ROVER)
    assert (model.name, model.root) == ("rover", "base_link")
    names = [j.name for j in model.joints]
    assert names.index("mast_joint") < names.index("pan_joint") < names.index("tilt_joint")
    assert [model.frame("mana", link) for link in ("base_link", "Mast")] == ["mana/base", "mana/mast"]


def test_joints_rotate_and_translate_about_their_axes() -> None:
    joints = {j.name: j for j in read_urdf(ROVER).joints}
    T = joints["tilt_joint"].transform(0.3)
    np.testing.assert_allclose(T, se3.transform(se3.exp_so3([0, 0.3, 0]), [0, 0, 0.1]), atol=1e-12)
    np.testing.assert_allclose(joints["arm_joint"].transform(0.2)[:3, 3], [0.2, 0, 0])
    np.testing.assert_allclose(joints["mast_joint"].transform(1.0)[:3, 0], [0, 1, 0], atol=1e-12)
    assert joints["tilt_joint"].limits == (-1.0, 0.5)
    assert joints["arm_joint"].mimic == ("pan_joint", 0.1, 0.2)
    assert not joints["mast_joint"].movable


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<robot", "<!DOCTYPE x []><robot", "document type"),
        ("</robot>", "", "URDF"),
        ('type="continuous"', 'type="floating"', "floating"),
        ('<parent link="pan"/>', "", "no <parent>"),
        ('<parent link="pan"/>', '<parent link="neck"/>', "neck"),
        ('<parent link="Mast"/>', '<parent link="tilt"/>', "loop"),
        ('<link name="arm"/>', '<link name="arm"/><link name="leg"/>', "one root"),
        ('<link name="arm"/>', '<link name="arm"/><link name="arm"/>', "repeated"),
        ('xyz="0 2 0"', 'xyz="0 0 0"', "direction"),
        ('xyz="0 0 0.1"', 'xyz="0 0 up"', "numbers"),
        ('joint="pan_joint" multiplier', 'joint="mast_joint" multiplier', "mimics"),
    ],
)
def test_an_invalid_joint_tree_is_refused_by_name(old: str, new: str, message: str) -> None:
    assert old in ROVER
    with pytest.raises(ConfigurationError, match=message):
        read_urdf(ROVER.replace(old, new))
