# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of the running system become samples, plots and messages of the viewer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.bus import Message, keys
from cdff_common.bus.message import pack
from cdff_common.codecs import encode_payload
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import Pointcloud
from cdff_dev.logs.source import LogSample, recorded_header
from cdff_dev.view.drawings import Layer, Note, Number
from cdff_dev.view.live import States, Timeline, updates_of

NOW_NS = 5_000_000_000


def layers(key: str, body: dict[str, Any], states: States | None = None) -> list[Layer]:
    updates = [*updates_of(Message(key, pack(body), "", b""), states or States())]
    assert all(isinstance(update, Layer) for update in updates)
    return updates  # type: ignore[return-value]


def test_a_product_is_a_sample_and_a_failed_one_has_no_value() -> None:
    cloud = Pointcloud.from_points(np.eye(3), frame="site", stamp_ns=0)
    header = recorded_header("/mana/dem.cloud", 3, NOW_NS, frame="site")
    payload, encoding = encode_payload(cloud)
    key = keys.product("mana", "dem", "cloud")
    (sample,) = updates_of(Message(key, payload, encoding, header.to_attachment()), States())
    assert isinstance(sample, LogSample)
    assert (sample.stream, sample.type_name, sample.seq) == ("/mana/dem.cloud", "Pointcloud", 3)
    np.testing.assert_allclose(sample.value.points_m, np.eye(3))
    failed = replace(header, quality=Quality(Status.FAILED, ("no_ground",)))
    (sample,) = updates_of(Message(key, b"", encoding, failed.to_attachment()), States())
    assert isinstance(sample, LogSample)
    assert sample.value is None
    assert sample.header is not None
    assert sample.header.quality.reasons == ("no_ground",)


def test_the_status_of_a_dfpc_is_plotted_and_its_changes_are_messages() -> None:
    states, key = States(), keys.dfpc_status("mana", "dem")
    body = {"state": "active", "mean_step_cpu_s": 0.25, "pending": 2, "dropped": 0, "last_error": ""}
    first = layers(key, body, states)
    numbers = {layer.path: layer.drawing.value for layer in first if isinstance(layer.drawing, Number)}
    assert numbers["/mana/dem/timing/mean_step_cpu_s"] == 0.25
    assert [layer.drawing for layer in first if layer.path.endswith("notes")] == [
        Note("INFO", "dem is active")
    ]
    assert not [layer for layer in layers(key, body, states) if isinstance(layer.drawing, Note)]
    changed = layers(key, body | {"state": "error", "last_error": "no ground"}, states)
    assert changed[-1].drawing == Note("WARN", "dem is error: no ground")


def test_events_are_messages_and_active_alarms_warnings() -> None:
    (layer,) = layers(keys.event("mana", "activated"), {"dfpc": "dem", "state": "active", "job": ""})
    assert (layer.path, layer.drawing) == (
        "/mana/events/activated",
        Note("INFO", "activated: dfpc dem, state active"),
    )
    levels = []
    for active in (True, False):
        (layer,) = layers(keys.event("mana", "alarm"), {"what": "no clock", "active": active})
        assert isinstance(layer.drawing, Note)
        levels.append(layer.drawing.level)
    assert levels == ["WARN", "INFO"]


def test_the_progress_of_a_player_is_no_message() -> None:
    assert layers(keys.event("ground", "playback"), {"position_ns": 5}) == []


def test_states_have_the_time_of_the_mission_not_of_this_machine() -> None:
    timeline = Timeline()
    early, late = (Layer("/mana/dem/notes", "", Note("INFO", text)) for text in ("early", "late"))
    cloud = Pointcloud.from_points(np.eye(3), frame="site", stamp_ns=NOW_NS)
    sample = LogSample("/mana/dem.cloud", "Pointcloud", NOW_NS, 0, cloud)
    assert list(timeline.placed([early], None)) == []
    assert list(timeline.placed([sample], None)) == [(NOW_NS, early), sample]
    assert list(timeline.placed([late], None)) == [(NOW_NS, late)]
    assert list(timeline.placed([late], NOW_NS + 1)) == [(NOW_NS + 1, late)]
