# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Health of services in words."""

from __future__ import annotations

from typing import Any

import pytest

from services.dpm.operations.service_health import service_health

S = 10**9
DFPC = ("mana", "lidar_slam")


def dfpc(**changes: Any) -> dict[str, Any]:
    newest = {"pose": {"product": "pose", "t1_ns": 9 * S, "status": "OK", "reasons": []}}
    status = {"robot": "mana", "name": "lidar_slam", "state": "active", "newest_outputs": newest}
    return status | {"last_error": "", "dropped": 0, "malformed": 0} | changes


def alarm(source: str, severity: str = "warning") -> dict[str, Any]:
    return {"source": source, "severity": severity, "what": "it starts again and again"}


@pytest.mark.parametrize(
    ("status", "health", "text"),
    [
        (dfpc(), "good", "is active"),
        (dfpc(newest_outputs={}), "idle", "is active, no product yet"),
        (dfpc(state="inactive"), "idle", "is ready, not active"),
        (dfpc(state="inactive", last_error="no scan"), "degraded", "is not active: no scan"),
        (dfpc(state="unconfigured"), "idle", "waits for its configuration"),
        (dfpc(state="error", last_error="no map"), "failed", "has failed: no map"),
        (dfpc(dropped=3), "degraded", "is active, with problems: 3 samples dropped"),
        (
            dfpc(
                last_error="no odometry",
                newest_outputs={
                    "map": {"product": "dem", "t1_ns": S, "status": "DEGRADED", "reasons": ["few_points"]}
                },
            ),
            "degraded",
            "is active, with problems: no odometry, dem degraded (few_points)",
        ),
    ],
)
def test_a_running_dfpc_is_described(status: dict[str, Any], health: str, text: str) -> None:
    (row,) = service_health({DFPC: None}, [DFPC], [status], [], 10 * S)
    assert (row["scope"], row["service"], row["health"], row["text"]) == (*DFPC, health, text)


def test_services_that_do_not_run_have_failed() -> None:
    last_seen_ns = {("ground", "dpm"): None, ("mana", "icu"): 4 * S}
    rows = service_health(last_seen_ns, [DFPC], [], [], 10 * S)
    texts = {row["service"]: (row["health"], row["text"]) for row in rows}
    assert texts == {
        "dpm": ("good", "runs"),
        "icu": ("failed", "does not run; it ended 6 s ago"),
        "lidar_slam": ("failed", "has not started"),
    }
    (row,) = service_health({DFPC: S}, [], [dfpc()], [], 3601 * S)
    assert (row["text"], row["newest_t1_ns"]) == ("does not run; it ended 60 min ago", 9 * S)


@pytest.mark.parametrize("source", ["lidar_slam", "mana/lidar_slam"])
@pytest.mark.parametrize(("severity", "health"), [("warning", "degraded"), ("critical", "failed")])
def test_an_alarm_of_a_service_is_part_of_its_health(source: str, severity: str, health: str) -> None:
    alarms = [alarm(source, severity), alarm("elsewhere", "critical")]
    (row,) = service_health({DFPC: None}, [], [dfpc()], alarms, 10 * S)
    assert (row["health"], row["text"]) == (health, "is active; alarm: it starts again and again")
