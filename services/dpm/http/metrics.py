# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The lines of ``/metrics``, in Prometheus' text format (version 0.0.4)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import accumulate
from typing import Any


def dpm_lines(status: Mapping[str, Any]) -> list[str]:
    """Return the metrics of the DPM."""
    products = {
        f'{{robot="{robot}",type="{t}"}}': n
        for robot, of in status["by_robot"].items()
        for t, n in of.items()
    }
    operations = {f'{{operation="{name}"}}': n for name, n in sorted(status["counters"].items())}
    alarms = {_labels(alarm): 1 for alarm in status["alarms"]}
    return [
        *_metric("cdff_alarm", "gauge", "Active alarms: always 1.", alarms),
        *_metric(
            "cdff_dpm_free_bytes", "gauge", "Free space on the disk of the store.", {"": status["free_bytes"]}
        ),
        *_metric("cdff_dpm_products", "gauge", "Stored products.", products),
        *_metric(
            "cdff_dpm_payload_bytes", "gauge", "Size of the stored payloads.", {"": status["payload_bytes"]}
        ),
        *_metric("cdff_dpm_events_total", "counter", "Events in the history.", {"": status["events"]}),
        *_metric(
            "cdff_dpm_operations_total", "counter", "Operations since the start of the process.", operations
        ),
    ]


def orchestrator_lines(stat: Mapping[str, Any] | None) -> list[str]:
    """Return the metrics of the orchestrator; only ``up 0`` if ``stat`` is None."""
    lines = _metric(
        "cdff_orchestrator_up", "gauge", "1 if the orchestrator answers.", {"": int(stat is not None)}
    )
    if stat is None:
        return lines
    requests = {f'{{type="{r["type"]}",state="{r["state"]}"}}': r["count"] for r in stat["requests"]}
    actions = {f'{{verb="{a["verb"]}",ok="{str(a["ok"]).lower()}"}}': a["count"] for a in stat["actions"]}
    answers = stat["answers"]
    below = list(accumulate(answers["counts"]))
    edges = (*(f"{edge:g}" for edge in answers["edges_s"]), "+Inf")
    histogram = {f'_bucket{{le="{edge}"}}': n for edge, n in zip(edges, below, strict=True)}
    histogram |= {"_sum": f"{answers['sum_s']:.6f}", "_count": below[-1]}
    return [
        *lines,
        *_metric(
            "cdff_orchestrator_requests_open",
            "gauge",
            "Product requests without a final answer.",
            {"": stat["open"]},
        ),
        *_metric("cdff_orchestrator_requests_total", "counter", "Product requests by their state.", requests),
        *_metric(
            "cdff_orchestrator_actions_total",
            "counter",
            "Calls to DFPCs and instrument control units.",
            actions,
        ),
        *_metric(
            "cdff_orchestrator_answer_seconds",
            "histogram",
            "Time from a product request to its answer.",
            histogram,
        ),
    ]


def gateway_topics(statuses: Mapping[tuple[str, str], Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the counters of each topic of gateways, by robot and service; other gateways have none."""
    rows = []
    for (robot, gateway), status in sorted(statuses.items()):
        inputs = [("in", topic, counters) for topic, counters in status.get("inputs", {}).items()]
        outputs = [("out", counters["topic"], counters) for counters in status.get("outputs", ())]
        for direction, topic, counters in inputs + outputs:
            names = {"robot": robot, "gateway": gateway, "direction": direction, "topic": topic}
            values = ("type", "received", "forwarded", "dropped", "latency_ms", "least_age_ms", "last_fault")
            rows.append({**names, **{name: counters[name] for name in values}})
    return rows


def gateway_lines(statuses: Mapping[tuple[str, str], Mapping[str, Any]]) -> list[str]:
    """Return the metrics of gateways: messages of each topic, the latency, and the offset of the clock."""
    received: dict[str, Any] = {}
    forwarded: dict[str, Any] = {}
    dropped: dict[str, Any] = {}
    latency_s: dict[str, Any] = {}
    age_s: dict[str, Any] = {}
    for row in gateway_topics(statuses):
        names = {name: row[name] for name in ("robot", "gateway", "direction", "topic", "type")}
        labels = _label_text(names)
        received[labels] = row["received"]
        forwarded[labels] = row["forwarded"]
        latency_s[labels] = f"{row['latency_ms'] / 1e3:.6f}"
        if row["least_age_ms"] is not None:
            age_s[labels] = f"{row['least_age_ms'] / 1e3:.6f}"
        for reason, count in sorted(row["dropped"].items()):
            dropped[_label_text({**names, "reason": reason})] = count
    if not received:
        return []
    return [
        *_metric("cdff_gateway_received_total", "counter", "Messages received by gateways.", received),
        *_metric("cdff_gateway_forwarded_total", "counter", "Messages forwarded by gateways.", forwarded),
        *_metric(
            "cdff_gateway_dropped_total", "counter", "Messages dropped by gateways, by reason.", dropped
        ),
        *_metric(
            "cdff_gateway_latency_seconds", "gauge", "Time in the gateway of the last messages.", latency_s
        ),
        *_metric(
            "cdff_gateway_least_age_seconds",
            "gauge",
            "Least time from the stamp of a message to its arrival; negative if the robot's clock is ahead.",
            age_s,
        ),
    ]


def _labels(alarm: Mapping[str, Any]) -> str:
    """Return the labels of an alarm; its texts come from other services, so that they are escaped."""
    values = {name: alarm[name] for name in ("kind", "source", "severity")}
    values["acknowledged"] = str(alarm["acknowledged_by"] is not None).lower()
    return _label_text(values)


def _label_text(values: Mapping[str, Any]) -> str:
    return "{" + ",".join(f"{name}={json.dumps(str(value))}" for name, value in values.items()) + "}"


def _metric(name: str, kind: str, meaning: str, samples: Mapping[str, Any]) -> list[str]:
    """Return the lines of a metric; ``samples`` are its values by suffix and labels."""
    values = (f"{name}{end} {value}" for end, value in samples.items())
    return [f"# HELP {name} {meaning}", f"# TYPE {name} {kind}", *values]
