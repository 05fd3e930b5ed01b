# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The alerting rules name existing metrics, have a rule for each kind of alarm, and pass promtool."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from services.dpm.http.metrics import dpm_lines, gateway_lines, orchestrator_lines

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "deploy" / "prometheus"
GROUPS: list[dict[str, Any]] = yaml.safe_load((FOLDER / "rules.yml").read_text(encoding="utf-8"))["groups"]
RULES: list[dict[str, Any]] = [rule for group in GROUPS for rule in group["rules"]]
ALARM: dict[str, Any] = {
    "kind": "disk_full",
    "source": 'a "name" \\ with\nnewline',
    "severity": "critical",
    "acknowledged_by": None,
}
STATUS: dict[str, Any] = {
    "by_robot": {"mana": {"pose": 3}},
    "counters": {"inserted": 3, "refused": 0},
    "alarms": [ALARM],
    "free_bytes": 10,
    "payload_bytes": 20,
    "events": 4,
}
ANSWERS = {"counts": [1, 2, 0], "edges_s": [0.1, 1.0], "sum_s": 1.5}
STAT: dict[str, Any] = {
    "requests": [{"type": "pose", "state": "closed", "count": 3}],
    "actions": [{"verb": "activate", "ok": True, "count": 1}],
    "answers": ANSWERS,
    "open": 1,
}
TOPIC = {"type": "LaserScan", "received": 9, "forwarded": 8, "latency_ms": 2.0, "dropped": {"size": 1}}
GATEWAYS = {("mana", "gateway_ros2"): {"inputs": {"/scan": TOPIC}, "outputs": []}}
METRICS = "\n".join([*dpm_lines(STATUS), *orchestrator_lines(STAT), *gateway_lines(GATEWAYS)]) + "\n"


@pytest.fixture(scope="module")
def promtool() -> str:
    """The path of promtool."""
    program = shutil.which("promtool")
    if program is None:
        pytest.skip("promtool is not installed; run `make peers`")
    return program


def run(*command: str, text: str | None = None) -> None:
    """Run a command in the folder of the rules, and show its output if it fails."""
    result = subprocess.run(command, cwd=FOLDER, input=text, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_each_kind_of_alarm_has_a_rule_that_is_silent_once_it_is_acknowledged() -> None:
    page = (ROOT / "docs" / "dpm-operation.md").read_text(encoding="utf-8")
    kinds = re.findall(r"^\| `(\w+)` \| .* \| .* \|$", page.partition("\n## Alarms")[2], re.MULTILINE)
    expressions = [rule["expr"] for rule in GROUPS[0]["rules"]]
    assert expressions == [f'cdff_alarm{{kind="{kind}", acknowledged="false"}} == 1' for kind in kinds]


def test_rules_name_metrics_of_the_dpm_only() -> None:
    metrics = set(re.findall(r"^# TYPE (\w+)", METRICS, re.MULTILINE))
    named = {
        name.removesuffix("_bucket") for rule in RULES for name in re.findall(r"\bcdff_\w+", rule["expr"])
    }
    assert named <= metrics
    assert len({rule["alert"] for rule in RULES}) == len(RULES)


def test_promtool_accepts_the_rules_and_their_tests_pass(promtool: str) -> None:
    run(promtool, "check", "rules", "rules.yml")
    run(promtool, "test", "rules", "rules_test.yml")


def test_promtool_accepts_the_metrics(promtool: str) -> None:
    run(promtool, "check", "metrics", text=METRICS)
