# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What ``/metrics`` says, in Prometheus' text format (version 0.0.4)."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate
from typing import Any


def dpm_lines(status: Mapping[str, Any]) -> list[str]:
    """What the DPM holds and did."""
    lines = ["# TYPE cdff_dpm_products gauge"]
    for robot, products in status["by_robot"].items():
        lines += [f'cdff_dpm_products{{robot="{robot}",type="{t}"}} {n}' for t, n in products.items()]
    lines += ["# TYPE cdff_dpm_payload_bytes gauge", f"cdff_dpm_payload_bytes {status['payload_bytes']}"]
    lines += ["# TYPE cdff_dpm_events_total counter", f"cdff_dpm_events_total {status['events']}"]
    lines += ["# TYPE cdff_dpm_operations_total counter"]
    lines += [f'cdff_dpm_operations_total{{operation="{name}"}} {n}' for name, n in sorted(status["counters"].items())]
    return lines


def orchestrator_lines(stat: Mapping[str, Any] | None) -> list[str]:
    """What the orchestrator did since its start; only that it is away where ``stat`` is None."""
    lines = ["# TYPE cdff_orchestrator_up gauge", f"cdff_orchestrator_up {int(stat is not None)}"]
    if stat is None:
        return lines
    lines += ["# TYPE cdff_orchestrator_requests_open gauge", f"cdff_orchestrator_requests_open {stat['open']}"]
    lines += ["# TYPE cdff_orchestrator_requests_total counter"]
    for r in stat["requests"]:
        lines.append(f'cdff_orchestrator_requests_total{{type="{r["type"]}",state="{r["state"]}"}} {r["count"]}')
    lines += ["# TYPE cdff_orchestrator_actions_total counter"]
    for a in stat["actions"]:
        ok = str(a["ok"]).lower()
        lines.append(f'cdff_orchestrator_actions_total{{verb="{a["verb"]}",ok="{ok}"}} {a["count"]}')
    answers = stat["answers"]
    below = list(accumulate(answers["counts"]))
    name = "cdff_orchestrator_answer_seconds"
    lines += [f"# TYPE {name} histogram"]
    lines += [f'{name}_bucket{{le="{edge:g}"}} {n}' for edge, n in zip(answers["edges_s"], below, strict=False)]
    lines += [f'{name}_bucket{{le="+Inf"}} {below[-1]}', f"{name}_sum {answers['sum_s']:.6f}"]
    lines += [f"{name}_count {below[-1]}"]
    return lines
