# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The exchange over contact windows over HTTP, with a bus double."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Bus, Reply
from cdff_common.errors import UnavailableError
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

URL = "/api/v1/contact"


class Exchange:
    """Bus double that records calls, and answers with an estimate or an error."""

    def __init__(self) -> None:
        self.received: list[tuple[str, dict[str, Any]]] = []
        self.error: Exception | None = None

    def call(self, key: str, parameters: dict[str, Any], **_: Any) -> Reply:
        self.received.append((key, parameters))
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
