# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The bus of a rehearsal answers, tells and remembers as the real one does."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from cdff_common.bus import Message, Reply, Request
from cdff_common.clock import ManualClock
from cdff_common.errors import NoAnswerError
from services.rehearsal.local_bus import LocalBus


@pytest.fixture
def bus() -> LocalBus:
    return LocalBus(ManualClock())


def test_messages_reach_who_subscribed_to_their_key_and_latched_ones_who_comes_later(bus: LocalBus) -> None:
    heard: list[str] = []

    def hear(message: Message) -> None:
        heard.append(message.key)

    bus.publish_latched("a/mana/status", {"state": "active"})
    bus.publish_map("a/mana/event", {})
    bus.subscribe("a/*/status", hear)
    bus.publish_map("a/minnie/status", {})
    bus.publish_map("a/minnie/status/more", {})
    assert heard == ["a/mana/status", "a/minnie/status"]


def test_calls_are_answered_by_key_before_by_expression(bus: LocalBus) -> None:
    def several(request: Request) -> Iterator[Reply]:
        yield Reply.of({"n": 1}, final=False)
        yield Reply.of({"key": request.key, **request.parameters})

    bus.serve("a/product/*", several)
    bus.serve("a/product/one", lambda _: Reply.of("exact"))
    assert bus.call("a/product/one").body() == "exact"
    assert bus.call("a/product/two", {"len": 5}).body() == {"key": "a/product/two", "len": "5"}
    with pytest.raises(NoAnswerError, match="a/other"):
        bus.call("a/other")


def test_tokens_are_seen_by_who_watches_before_and_after(bus: LocalBus) -> None:
    seen: list[str] = []
    bus.declare_alive("mana", "icu")
    bus.watch_alive("cdff/@v1/*/@alive/*", lambda key, _alive: seen.append(key))
    bus.declare_alive("mana", "dpm")
    assert seen == ["cdff/@v1/mana/@alive/icu", "cdff/@v1/mana/@alive/dpm"]
    assert bus.alive("cdff/@v1/mana/@alive/dpm") == {"cdff/@v1/mana/@alive/dpm"}
