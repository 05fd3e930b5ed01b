# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Repetition of a request by the client, with a scripted bus."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from cdff_common.bus import Bus, Reply
from cdff_common.client import Client
from cdff_common.client import client as module
from cdff_common.errors import NoAnswerError
from cdff_common.interfaces.product import Header

REFERENCE = Reply.of(
    {"id": "00000000-0000-4000-8000-000000000001", "format": "uper"}, kind="reference", final=True
)


class ScriptedBus:
    """A bus with one outcome for each request; products cannot be retrieved."""

    def __init__(self, *outcomes: Reply | NoAnswerError) -> None:
        self.outcomes = list(outcomes)
        self.requests: list[str] = []

    def alive(self, _keyexpr: str) -> set[str]:
        return set()

    def call_stream(self, _key: str, query: Mapping[str, Any], **_: object) -> Iterator[Reply]:
        self.requests.append(query["request"])
        outcome = self.outcomes.pop(0)
        if isinstance(outcome, NoAnswerError):
            raise outcome
        yield outcome

    def call(self, *_: object, **__: object) -> Reply:
        raise NoAnswerError("the DPM does not answer")


@pytest.fixture(autouse=True)
def short_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_RETRY_S", 0.01)


def names_of_requests(monkeypatch: pytest.MonkeyPatch, *outcomes: Reply | NoAnswerError) -> list[str]:
    """Request a product whose retrieval fails; return the name of each request that was sent."""
    bus = ScriptedBus(*outcomes)
    monkeypatch.setattr(Bus, "open", lambda *_, **__: bus)
    with pytest.raises(NoAnswerError, match="the DPM"):
        Client().request("dem", robot="mana", deadline_s=5.0)
    return bus.requests


def test_a_request_is_repeated_under_a_new_name_while_no_orchestrator_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    silence = NoAnswerError("no orchestrator")
    assert len(set(names_of_requests(monkeypatch, silence, silence, REFERENCE))) == 3


def test_an_answered_request_is_not_repeated_when_its_product_cannot_be_retrieved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert len(names_of_requests(monkeypatch, REFERENCE, REFERENCE)) == 1


def test_a_product_is_retrieved_in_a_format(monkeypatch: pytest.MonkeyPatch) -> None:
    product = "00000000-0000-4000-8000-000000000001"
    header = Header(product, 0, 0, 0, "site", "a/b/1")
    calls: list[tuple[str, Mapping[str, Any]]] = []

    class StoringBus:
        def call(self, key: str, query: Mapping[str, Any], **_: object) -> Reply:
            calls.append((key, query))
            return Reply(b"ply", "model/ply", header.to_dict())

    monkeypatch.setattr(Bus, "open", lambda *_, **__: StoringBus())
    answer = Client().get(product, "ply")
    assert (answer.data, answer.type_name, answer.header.id) == (b"ply", "model/ply", product)
    assert calls == [("cdff/@v1/ground/dpm/@rpc/get", {"id": product, "format": "ply"})]
