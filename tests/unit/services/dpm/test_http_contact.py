# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The exchange over contact windows over HTTP, with a bus double."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Bus, Reply
from cdff_common.bus.message import unpack
from cdff_common.errors import InputError, UnavailableError
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

URL = "/api/v1/contact"


class Exchange:
    """Bus double that records calls, and answers with an estimate or an error."""

    def __init__(self) -> None:
        self.received: list[tuple[str, dict[str, Any]]] = []
        self.payloads: list[bytes] = []
        self.error: Exception | None = None

    def call(self, key: str, parameters: dict[str, Any], payload: bytes = b"", **_: Any) -> Reply:
        self.received.append((key, parameters))
        self.payloads.append(payload)
        if self.error is not None:
            raise self.error
        return Reply.of({"items": [{"id": "a", "arrival_ns": 1_700_000_000_000_000_001}], "others": []})


@pytest.fixture
def exchange() -> Exchange:
    return Exchange()


@pytest.fixture
def http(dpm: Dpm, tmp_path: Path, exchange: Exchange) -> TestClient:
    context = Context(dpm, Settings(tmp_path), cast(Bus, exchange))
    return TestClient(create_app(context), base_url="http://127.0.0.1:8080", raise_server_exceptions=False)


def test_the_estimate_of_a_robot_is_returned_with_exact_times(http: TestClient, exchange: Exchange) -> None:
    answer = http.get(URL, params={"what": "estimate", "robot": "mana", "limit": "10"})
    assert answer.status_code == 200
    assert answer.json()["items"] == [{"id": "a", "arrival_ns": "1700000000000000001"}]
    parameters = {"what": "estimate", "robot": "mana", "limit": 10}
    assert exchange.received == [("cdff/@v1/ground/dpm/@rpc/contact", parameters)]


@pytest.mark.parametrize("query", ["what=all", "robot=a/b", "limit=0", "first=a", "expires_s=5", "id=a b"])
def test_a_wrong_parameter_is_refused_and_nothing_can_be_changed(
    http: TestClient, exchange: Exchange, query: str
) -> None:
    assert http.get(f"{URL}?{query}").status_code == 422
    assert exchange.received == []


def test_the_reason_of_a_dpm_without_contact_plan_is_passed_on(http: TestClient, exchange: Exchange) -> None:
    exchange.error = UnavailableError("this DPM has no contact plan; start it with …")
    answer = http.get(URL)
    assert answer.status_code == 503
    assert "has no contact plan" in answer.json()["detail"]


def test_a_product_is_sent_first_and_its_estimate_returned(http: TestClient, exchange: Exchange) -> None:
    answer = http.post(f"{URL}/first", json={"robot": "mana", "id": "a"})
    assert (answer.status_code, answer.json()["items"][0]["id"]) == (200, "a")
    assert exchange.received == [("cdff/@v1/ground/dpm/@rpc/contact", {"robot": "mana", "first": "a"})]
    exchange.error = InputError("first='a': no product of mana of which only the record is here")
    refused = http.post(f"{URL}/first", json={"robot": "mana", "id": "a"})
    assert (refused.status_code, "no product of mana" in refused.json()["detail"]) == (422, True)


def test_a_request_is_kept_with_its_parameters_as_texts(http: TestClient, exchange: Exchange) -> None:
    body = {"robot": "mana", "parameters": {"type": "dem", "max_age_s": 60}, "expires_s": 30, "id": "r1"}
    assert http.post(f"{URL}/requests", json=body).status_code == 200
    key, parameters = exchange.received[0]
    assert (key, parameters) == (
        "cdff/@v1/ground/dpm/@rpc/contact",
        {"robot": "mana", "expires_s": 30, "id": "r1"},
    )
    assert unpack(exchange.payloads[0]) == {"parameters": {"type": "dem", "max_age_s": "60"}}


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("first", {"robot": "mana"}),
        ("first", {"robot": "a/b", "id": "a"}),
        ("first", {"robot": "mana", "id": "a", "priority": 0}),
        ("requests", {"robot": "mana", "parameters": {}}),
        ("requests", {"robot": "mana", "parameters": {"type": ["dem"]}}),
        ("requests", {"robot": "mana", "parameters": {"type": "dem"}, "expires_s": 0}),
        ("requests", {"robot": "mana", "parameters": {"type": "dem"}, "id": "a b"}),
    ],
)
def test_a_wrong_body_is_refused_and_nothing_is_changed(
    http: TestClient, exchange: Exchange, path: str, body: dict[str, Any]
) -> None:
    assert http.post(f"{URL}/{path}", json=body).status_code == 422
    assert exchange.received == []
