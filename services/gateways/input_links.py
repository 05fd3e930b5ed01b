# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The inputs of the settings by their topics."""

from __future__ import annotations

from collections.abc import Sequence

from cdff_common.bus import Bus
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.inputs import InputLink
from services.gateways.settings import InputTopic
from services.gateways.stereo_inputs import StereoLink
from services.ros_messages.message_types import RosTypes


def links_by_topic(
    entries: Sequence[InputTopic], names: FrameNames, ros_types: RosTypes, bus: Bus, tree: FrameTree
) -> dict[str, list[InputLink]]:
    """Return one link for each entry, in the order of the entries, by the first topic of the entry.

    All links add their transforms to ``tree``, which refuses those that contradict it.
    """
    links: dict[str, list[InputLink]] = {}
    for entry in entries:
        kind = InputLink if entry.right is None else StereoLink
        links.setdefault(entry.topic, []).append(kind(entry, names, ros_types, bus, tree))
    return links
