# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of frames on both sides, and trees of frames."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

from cdff_common.errors import InputError, UnavailableError
from services.gateways.dpm_frames import DpmFrames
from services.gateways.frames import FrameNames, FrameTree


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
    tree.update_dpm({"mana/base": "mana/odom", "mana/mast": "mana/base"})
    tree.add("mana/footprint", "mana/base")  # of the robot alone: it has frames of its own
    tree.add("site", "mana/odom", with_dpm=True)
    with pytest.raises(InputError, match="mana/mast below site: it is already below mana/base in the DPM"):
        tree.add("site", "mana/mast", with_dpm=True)
    tree.update_dpm({"mana/mast": "mana/arm", "mana/arm": "mana/base"})
    with pytest.raises(InputError, match="mana/mast is below mana/footprint, a loop"):
        tree.add("mana/mast", "mana/footprint", with_dpm=True)
    assert tree.to_map()["dpm_frames"] == 2
    assert tree.to_map()["parents"] == {"mana/base": "mana/footprint", "mana/odom": "site"}


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

        frames: ClassVar[list[dict[str, str]] | None] = [{"frame": "mana/mast", "parent": "mana/base"}]

        def call(self, key: str, _: object, **__: object) -> Any:
            assert key == "cdff/@v1/mana/dpm/@rpc/frames"
            if self.frames is None:
                raise UnavailableError("no DPM")
            return SimpleNamespace(body=lambda: {"frames": self.frames})

    bus, tree = Calls(), FrameTree()
    frames = DpmFrames(bus, "mana", tree)  # type: ignore[arg-type]
    frames.update()
    bus.frames = None  # type: ignore[misc]
    frames.update()
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
