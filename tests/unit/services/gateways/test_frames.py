# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of frames on both sides, and trees of frames."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
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


def test_a_tree_has_a_largest_number_of_frames() -> None:
    tree = FrameTree()
    for i in range(1000):
        tree.add("site", f"f{i}")
    with pytest.raises(InputError, match="at most 1000 frames"):
        tree.add("site", "one_more")
    tree.add("site", "f0")


def test_names_of_frames_are_translated_there_and_back() -> None:
    names = FrameNames("mana", {"base_link": "mana/base", "map": "site"})
    assert [names.of_cdff(n) for n in ("map", "base_link", "lidar")] == ["site", "mana/base", "mana/lidar"]
    assert [names.of_robot(n) for n in ("site", "mana/base", "mana/lidar")] == ["map", "base_link", "lidar"]
