# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Health of each service of a mission in words, from liveliness tokens, statuses of DFPCs and alarms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum
from typing import Any

#: Scope and name of a service, as in its liveliness token.
Service = tuple[str, str]


class Health(StrEnum):
    """Health of a service."""

    GOOD = "good"
    IDLE = "idle"
    DEGRADED = "degraded"
    FAILED = "failed"


def service_health(
    last_seen_ns: Mapping[Service, int | None],
    expected: Iterable[Service],
    dfpcs: Iterable[Mapping[str, Any]],
    alarms: Iterable[Mapping[str, Any]],
    now_ns: int,
) -> list[dict[str, Any]]:
    """Return ``scope``, ``service``, ``health``, ``text`` and ``newest_t1_ns`` of each service.

    Parameters
    ----------
    last_seen_ns : mapping of (scope, service) to int or None
        Mission time at which a liveliness token disappeared; None while it exists.
    expected : iterable of (scope, service)
        DFPCs of the profiles.
    dfpcs : iterable of mapping
        Newest status of each DFPC (``ServiceMonitor.all_dfpcs``).
    alarms : iterable of mapping
        Active alarms as plain data.
    now_ns : int
        Mission time.
    """
    statuses = {(str(body["robot"]), str(body["name"])): body for body in dfpcs}
    by_source: dict[str, list[Mapping[str, Any]]] = {}
    for alarm in alarms:
        by_source.setdefault(str(alarm["source"]), []).append(alarm)
    rows = []
    for scope, service in sorted({*last_seen_ns, *expected, *statuses}):
        status = statuses.get((scope, service))
        if (scope, service) not in last_seen_ns:
            health, text = Health.FAILED, "has not started"
        elif (seen_ns := last_seen_ns[scope, service]) is not None:
            health, text = Health.FAILED, f"does not run; it ended {_age(now_ns - seen_ns)} ago"
        elif status is None:
            health, text = Health.GOOD, "runs"
        else:
            health, text = _of_dfpc(status)
        own_alarms = [alarm for name in (service, f"{scope}/{service}") for alarm in by_source.get(name, [])]
        for alarm in own_alarms:
            is_critical = alarm["severity"] == "critical"
            health = Health.FAILED if is_critical or health is Health.FAILED else Health.DEGRADED
        texts = [text, *(f"alarm: {alarm['what']}" for alarm in own_alarms)]
        newest_ns = max(_capture_ends_ns(status), default=None)
        rows.append(
            {
                "scope": scope,
                "service": service,
                "health": str(health),
                "text": "; ".join(texts),
                "newest_t1_ns": newest_ns,
            }
        )
    return rows


def _of_dfpc(status: Mapping[str, Any]) -> tuple[Health, str]:
    """Return the health of a running DFPC and its description."""
    state, error = str(status.get("state", "")), str(status.get("last_error") or "")
    if state == "error":
        return Health.FAILED, f"has failed: {error or 'no reason is stated'}"
    if state == "unconfigured":
        return Health.IDLE, "waits for its configuration"
    if state != "active":
        return (
            (Health.DEGRADED, f"is not active: {error}") if error else (Health.IDLE, "is ready, not active")
        )
    outputs = [output for output in status.get("newest_outputs", {}).values() if output["status"] != "OK"]
    problems = [*([error] if error else []), *(_output_problem(output) for output in outputs)]
    problems += [
        f"{status[name]} samples {words}"
        for name, words in (("dropped", "dropped"), ("malformed", "malformed"))
        if status.get(name)
    ]
    if problems:
        return Health.DEGRADED, f"is active, with problems: {', '.join(problems)}"
    if not status.get("newest_outputs"):
        return Health.IDLE, "is active, no product yet"
    return Health.GOOD, "is active"


def _output_problem(output: Mapping[str, Any]) -> str:
    reasons = ", ".join(output["reasons"])
    return f"{output['product']} {str(output['status']).lower()}" + (f" ({reasons})" if reasons else "")


def _capture_ends_ns(status: Mapping[str, Any] | None) -> Iterator[int]:
    for output in (status or {}).get("newest_outputs", {}).values():
        yield int(output["t1_ns"])


def _age(age_ns: int) -> str:
    """Return a time span in words."""
    age_s = max(age_ns, 0) * 1e-9
    if age_s < 120.0:
        return f"{age_s:.0f} s"
    return f"{age_s / 60.0:.0f} min" if age_s < 7200.0 else f"{age_s / 3600.0:.1f} h"
