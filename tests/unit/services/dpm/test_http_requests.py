# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Product requests over HTTP are passed to the orchestrator with all parameters."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Bus
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import elevation, put_arguments

PARAMETERS = {"type": "dem", "robot": "mana", "region": "circle:0,0,10", "max_age_s": "60"}
URL = "/api/v1/requests"


class Orchestrator:
    """Bus double whose orchestrator records the parameters of requests."""

    def __init__(self) -> None:
        self.received: list[dict[str, str]] = []
        self.jobs: list[dict[str, Any]] = []

    def call(self, _key: str, parameters: dict[str, str], **_: Any) -> SimpleNamespace:
        self.received.append(parameters)
        jobs = self.jobs if "job" not in parameters else self.jobs[0]
        body = {"jobs": jobs, "leases": []} if isinstance(jobs, list) else jobs
        return SimpleNamespace(attachment={"kind": "reference", "t1_ns": 5}, body=lambda: body)


@pytest.fixture
def orchestrator() -> Orchestrator:
    return Orchestrator()


@pytest.fixture
def http_with_bus(dpm: Dpm, tmp_path: Path, orchestrator: Orchestrator) -> TestClient:
    context = Context(dpm, Settings(tmp_path), cast(Bus, orchestrator))
    return TestClient(create_app(context), base_url="http://127.0.0.1:8080", raise_server_exceptions=False)


def test_query_and_json_body_are_equivalent(http_with_bus: TestClient, orchestrator: Orchestrator) -> None:
    answers = [
        http_with_bus.post(URL, params=PARAMETERS),
        http_with_bus.post(URL, json={**PARAMETERS, "max_age_s": 60}),
        http_with_bus.post(
            URL, params={"type": "dem"}, json={k: v for k, v in PARAMETERS.items() if k != "type"}
        ),
    ]
    assert [a.status_code for a in answers] == [200, 200, 200]
    assert answers[0].json() == {"kind": "reference", "t1_ns": "5"}
    assert orchestrator.received == [{**PARAMETERS, "deliver": "reference"}] * 3


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"params": PARAMETERS, "json": {"robot": "mana"}}, "repeated"),
        (
            {"json": {"type": "dem", "region": {"circle": 1}}},
            "region: a JSON dict, expected a text or a number",
        ),
        ({"json": {"type": "dem", "max_age_s": None}}, "max_age_s"),
        ({"json": ["dem"]}, "body"),
        ({"content": b"type=dem", "headers": {"Content-Type": "text/plain"}}, "body"),
        ({}, "no parameters: give them in the query"),
    ],
)
def test_invalid_parameters_are_refused_with_the_reason(
    http_with_bus: TestClient, orchestrator: Orchestrator, arguments: dict[str, Any], reason: str
) -> None:
    answer = http_with_bus.post(URL, **arguments)
    assert answer.status_code == 422
    assert reason in answer.text
    assert orchestrator.received == []


def test_results_say_if_their_product_is_stored(
    http_with_bus: TestClient, orchestrator: Orchestrator, dpm: Dpm
) -> None:
    _, stored = dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1, resolution_m=0.1))
    derived = "6fad6a70-a6b6-55d2-86e7-c9e3d46a11f6"
    results = [{"kind": "product", "id": stored.id}, {"kind": "product", "id": derived}, None]
    orchestrator.jobs = [{"job": str(i), "result": result} for i, result in enumerate(results)]
    jobs = http_with_bus.get(URL).json()["jobs"]
    assert [(job["result"] or {}).get("stored") for job in jobs] == [True, False, None]
    assert http_with_bus.get(f"{URL}/0").json()["result"]["stored"] is True
