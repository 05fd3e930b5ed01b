# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The spans of one request through orchestrator, DFPC host and DPM are one trace."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus
from cdff_common.client import Client
from cdff_dev.ports import free_port
from tests.integration.conftest import process_starter
from tests.integration.test_orchestrator import System
from tests.support.wheel_odometry import Driver

pytestmark = pytest.mark.integration


def spans_of(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the spans by name, earliest first, with the process that recorded them as ``service``."""
    spans: dict[str, list[dict[str, Any]]] = {}
    for file in folder.glob("*.jsonl"):
        for line in file.read_text().splitlines():
            for resource in json.loads(line)["resourceSpans"]:
                (service,) = (a["value"]["stringValue"] for a in resource["resource"]["attributes"])
                for span in resource["scopeSpans"][0]["spans"]:
                    spans.setdefault(span["name"], []).append({**span, "service": service})
    return {name: sorted(found, key=lambda s: int(s["startTimeUnixNano"])) for name, found in spans.items()}


def test_a_request_is_one_trace_through_orchestrator_host_and_dpm(tmp_path: Path) -> None:
    pytest.importorskip("opentelemetry.sdk.trace", reason="install the extra otel: `make peers`")
    endpoint, traces = f"tcp/127.0.0.1:{free_port()}", tmp_path / "traces"
    with process_starter(endpoint, tmp_path, CDFF_TRACES=str(traces)) as spawn:
        system = System(spawn, endpoint, f"127.0.0.1:{free_port()}", tmp_path)
        system.wait_ready()
        with Bus.open(endpoint, name="driver") as bus:
            driver = Driver(bus)
            with Client(endpoint) as client:
                assert client.request("pose", robot="mana", deadline_s=20.0).header is not None
            driver.stop()
    spans = spans_of(traces)
    (request,) = spans["orchestrator.request"]
    trace = request["traceId"]
    (activation,) = spans["orchestrator.activate"]
    (activated,) = spans["dfpc/troublemaker.activate"]
    step, put, read = spans["troublemaker.step"][0], spans["dpm.put"][0], spans["dpm.get"][0]
    assert request["parentSpanId"] == ""
    assert activation["parentSpanId"] == request["spanId"]
    assert activated["parentSpanId"] == activation["spanId"]
    assert step["parentSpanId"] == activated["spanId"]
    steps = {span["spanId"] for span in spans["troublemaker.step"]}
    assert {span["parentSpanId"] for span in spans["dpm.put"]} <= steps
    assert read["parentSpanId"] == request["spanId"]
    found = [span for same_name in spans.values() for span in same_name]
    assert {span["traceId"] for span in found} == {trace}
    services = (request, activation, activated, step, put, read)
    names = ("orchestrator", "orchestrator", "mana_troublemaker", "mana_troublemaker", "dpm", "dpm")
    assert tuple(span["service"] for span in services) == names
