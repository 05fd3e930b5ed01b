# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The local bus answers calls, publishes and latches messages like the real bus."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from cdff_common.bus import Message, Reply, Request
from cdff_common.clock import ManualClock
from cdff_common.errors import NoAnswerError
from cdff_dev.mission_replay.local_bus import LocalBus


@pytest.fixture
def bus() -> LocalBus:
    return LocalBus(ManualClock())


def test_messages_reach_subscribers_and_latched_ones_late_subscribers(bus: LocalBus) -> None:
    keys_received: list[str] = []

    def record_key(message: Message) -> None:
        keys_received.append(message.key)

    bus.publish_latched("a/mana/status", {"state": "active"})
    bus.publish_map("a/mana/event", {})
    bus.subscribe("a/*/status", record_key)
    bus.publish_map("a/minnie/status", {})
    bus.publish_map("a/minnie/status/more", {})
    assert keys_received == ["a/mana/status", "a/minnie/status"]


def test_an_exact_key_precedes_a_key_expression(bus: LocalBus) -> None:
    def several(request: Request) -> Iterator[Reply]:
        yield Reply.of({"n": 1}, final=False)
        yield Reply.of({"key": request.key, **request.parameters})

    bus.serve("a/product/*", several)
    bus.serve("a/product/one", lambda _: Reply.of("exact"))
    assert bus.call("a/product/one").body() == "exact"
    assert bus.call("a/product/two", {"len": 5}).body() == {"key": "a/product/two", "len": "5"}
    with pytest.raises(NoAnswerError, match="a/other"):
        bus.call("a/other")


def test_liveliness_tokens_are_seen_by_earlier_and_later_watchers(bus: LocalBus) -> None:
    tokens: list[str] = []
    bus.declare_alive("mana", "icu")
    bus.watch_alive("cdff/@v1/*/@alive/*", lambda key, _alive: tokens.append(key))
    bus.declare_alive("mana", "dpm")
    assert tokens == ["cdff/@v1/mana/@alive/icu", "cdff/@v1/mana/@alive/dpm"]
    assert bus.alive("cdff/@v1/mana/@alive/dpm") == {"cdff/@v1/mana/@alive/dpm"}
