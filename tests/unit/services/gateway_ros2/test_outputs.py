# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frames that the gateway publishes."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from services.gateway_ros2.outputs import FrameTree


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
