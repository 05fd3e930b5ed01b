# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State of the world at a mission time: frames with covariances and the items in them, as in EnviRe."""

from cdff_common.world.difference import FrameMotion, WorldDifference
from cdff_common.world.file import read_world, write_world
from cdff_common.world.history import WorldHistory
from cdff_common.world.world import World, WorldEdge, WorldItem

__all__ = [
    "FrameMotion",
    "World",
    "WorldDifference",
    "WorldEdge",
    "WorldHistory",
    "WorldItem",
    "read_world",
    "write_world",
]
