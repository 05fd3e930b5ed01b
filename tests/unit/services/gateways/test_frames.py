# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of frames on both sides, and trees of frames."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from cdff_common.errors import InputError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance
from services.gateways.dpm_frames import DpmFrames
from services.gateways.frames import FixedFrame, FrameNames, FrameTree


def fixed(parent: str, T: UncertainTransform | None = None) -> FixedFrame:
    """Return a fixed frame, by default at its parent."""
    return FixedFrame(parent, T or UncertainTransform.identity())


def pose(T: UncertainTransform, parent: str, child: str) -> TransformWithCovariance:
    return TransformWithCovariance.from_transform(T, parent=parent, child=child, stamp_ns=5000)


def test_a_frame_with_another_parent_or_below_itself_is_refused() -> None:
    tree = FrameTree()
    tree.add("site", "odom")
    tree.add("odom", "base")
    tree.add("odom", "base")
    with pytest.raises(InputError, match="frame base below site: it is already below odom"):
        tree.add("site", "base")
    with pytest.raises(InputError, match="frame site below base: base is below site, a loop"):
        tree.add("base", "site")
    with pytest.raises(InputError, match="a loop"):
        tree.add("mast", "mast")
    tree.add("base", "mast")


def test_transforms_are_joined_to_the_fixed_frames_of_the_dpm() -> None:
    tree = FrameTree()
    tree.update_dpm({"mana/base": fixed("mana/odom"), "mana/mast": fixed("mana/base")})
    tree.add("mana/footprint", "mana/base")  # of the robot alone: it has frames of its own
    tree.add("site", "mana/odom", with_dpm=True)
    with pytest.raises(InputError, match="mana/mast below site: it is already below mana/base in the DPM"):
        tree.add("site", "mana/mast", with_dpm=True)
    tree.update_dpm({"mana/mast": fixed("mana/arm"), "mana/arm": fixed("mana/base")})
    with pytest.raises(InputError, match="mana/mast is below mana/footprint, a loop"):
        tree.add("mana/mast", "mana/footprint", with_dpm=True)
    assert tree.to_map()["dpm_frames"] == 2
    assert tree.to_map()["parents"] == {"mana/base": "mana/footprint", "mana/odom": "site"}


def test_the_pose_of_a_frame_that_is_fixed_to_the_robot_is_stated_as_that_of_its_carrier() -> None:
    T_base_mast = UncertainTransform.from_xyz_rpy_deg((0.0, 0.0, 1.0), (0.0, 0.0, 90.0))
    T_mast_camera = UncertainTransform.from_xyz_rpy_deg((0.2, 0.0, 0.0), (0.0, 30.0, 0.0))
    T_vo_base = UncertainTransform.from_xyz_rpy_deg((3.0, -2.0, 0.5), (1.0, 2.0, 40.0))
    tree = FrameTree()
    tree.update_dpm(
        {"mana/mast": fixed("mana/base", T_base_mast), "mana/camera": fixed("mana/mast", T_mast_camera)}
    )
    found = tree.of_carrier(pose(T_vo_base @ T_base_mast @ T_mast_camera, "mana/vo", "mana/camera"))
    assert (found.parent_frame, found.child_frame, found.stamp_ns) == ("mana/vo", "mana/base", 5000)
    np.testing.assert_allclose(found.transform.matrix, T_vo_base.matrix, atol=1e-12)
    for unchanged in (
        pose(T_vo_base, "mana/vo", "mana/base"),
        pose(T_mast_camera, "mana/mast", "mana/camera"),
    ):
        assert tree.of_carrier(unchanged) is unchanged


def test_transforms_that_are_no_longer_stated_do_not_count() -> None:
    tree = FrameTree()
    tree.add("odom", "base", now_s=100.0)
    tree.add("base", "mast", now_s=100.0, is_static=True)
    tree.add("base", "mast", now_s=101.0)
    with pytest.raises(InputError, match="already below odom"):
        tree.add("site", "base", now_s=109.0)
    tree.add("site", "base", now_s=111.0)  # the robot has started again with other frames
    with pytest.raises(InputError, match="already below site"):
        tree.add("odom", "base", now_s=111.0)
    with pytest.raises(InputError, match="already below base"):
        tree.add("arm", "mast", now_s=1000.0)


def test_the_frames_of_the_dpm_are_taken_while_it_answers() -> None:
    class Calls:
        """The part of a bus that is used."""

        frames: ClassVar[list[dict[str, Any]] | None] = [
            {"frame": "mana/mast", "parent": "mana/base", "T": np.eye(4).tolist(), "covariance": None}
        ]

        def call(self, key: str, _: object, **__: object) -> Any:
            assert key == "cdff/@v1/mana/dpm/@rpc/frames"
            if self.frames is None:
                raise UnavailableError("no DPM")
            return SimpleNamespace(body=lambda: {"frames": self.frames})

    bus, tree = Calls(), FrameTree()
    frames = DpmFrames(bus, "mana", tree)  # type: ignore[arg-type]
    assert frames.update()
    bus.frames = None  # type: ignore[misc]
    assert not frames.update()
    with pytest.raises(InputError, match="in the DPM"):
        tree.add("site", "mana/mast", with_dpm=True)


def test_a_tree_has_a_largest_number_of_frames() -> None:
    tree = FrameTree()
    for i in range(1000):
        tree.add("site", f"f{i}", now_s=100.0)
    with pytest.raises(InputError, match="at most 1000 frames"):
        tree.add("site", "one_more", now_s=101.0)
    tree.add("site", "f0", now_s=105.0)
    tree.add("site", "one_more", now_s=111.0)  # the others have expired


def test_names_of_frames_are_translated_there_and_back() -> None:
    names = FrameNames("mana", {"base_link": "mana/base", "map": "site"})
    assert [names.of_cdff(n) for n in ("map", "base_link", "lidar")] == ["site", "mana/base", "mana/lidar"]
    assert [names.of_robot(n) for n in ("site", "mana/base", "mana/lidar")] == ["map", "base_link", "lidar"]
