# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The alerting rules name existing metrics, have a rule for each kind of alarm, and pass promtool; so do the
queries of the dashboards.
"""

from __future__ import annotations

import json
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
TOPIC = {
    "type": "LaserScan",
    "received": 9,
    "forwarded": 8,
    "latency_ms": 2.0,
    "least_age_ms": 1.0,
    "last_fault": "",
    "dropped": {"size": 1},
}
GATEWAYS = {("mana", "gateway_ros2"): {"inputs": {"/scan": TOPIC}, "outputs": []}}
DASHBOARDS: dict[str, Any] = {
    path.stem: json.loads(path.read_text(encoding="utf-8"))
    for path in sorted((ROOT / "deploy" / "grafana").glob("*.json"))
}
QUERIES: list[tuple[str, str]] = [
    (f"{name}: {panel['title']}", target["expr"])
    for name, board in DASHBOARDS.items()
    for panel in board["panels"]
    for target in panel["targets"]
]
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


def test_the_dashboards_show_every_metric_and_no_other() -> None:
    metrics = set(re.findall(r"^# TYPE (\w+)", METRICS, re.MULTILINE))
    shown = {
        name.removesuffix("_bucket") for _, query in QUERIES for name in re.findall(r"\bcdff_\w+", query)
    }
    assert shown == metrics


def test_panels_have_a_title_a_unit_and_their_own_place() -> None:
    assert len({board["uid"] for board in DASHBOARDS.values()}) == len(DASHBOARDS) == 2
    for board in DASHBOARDS.values():
        places = [(panel["gridPos"]["x"], panel["gridPos"]["y"]) for panel in board["panels"]]
        assert len(set(places)) == len(places)
        for panel in board["panels"]:
            assert panel["title"]
            assert panel["fieldConfig"]["defaults"]["unit"]
            assert panel["datasource"] == {"type": "prometheus", "uid": "${datasource}"}


def test_promtool_accepts_the_queries_of_the_dashboards(promtool: str, tmp_path: Path) -> None:
    rules = [{"record": f"dashboard:query:{i}", "expr": query} for i, (_, query) in enumerate(QUERIES)]
    file = tmp_path / "queries.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "dashboards", "rules": rules}]}), encoding="utf-8")
    run(promtool, "check", "rules", str(file))
