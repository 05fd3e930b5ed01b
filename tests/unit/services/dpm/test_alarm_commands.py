# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff alarms``: the list, the history, and the acknowledgement."""

from __future__ import annotations

import argparse
import json
from typing import Any

import pytest

from cdff_common.bus import Reply, keys
from cdff_common.errors import InputError
from services.alarms import Alarm, Severity
from services.dpm.cli.alarm_commands import register

DISK = Alarm(
    "disk_full", "dpm", Severity.CRITICAL, 1_700_000_000_000_000_000, "0 bytes are free", "free space"
)
ACTIVE = DISK.to_dict() | {"acknowledged_by": None, "acknowledged_ns": None}


class BusDouble:
    """Bus whose DPM has one active alarm and the events of its start and of another service."""

    def __init__(self) -> None:
        self.called: list[tuple[str, dict[str, Any]]] = []

    def __enter__(self) -> BusDouble:
        return self

    def __exit__(self, *_: object) -> None: ...

    def call(self, key: str, parameters: dict[str, Any], *, timeout_s: float) -> Reply:
        verb = key.rsplit("/", 1)[1]
        self.called.append((key, parameters))
        events = [DISK.to_event(is_active=active) | {"kind": "alarm"} for active in (True, False)]
        events.append({"kind": "alarm", "reason": "a DFPC failed"})
        return Reply.of(
            {
                "alarms": {"items": [ACTIVE]},
                "history": {"items": events, "next": 3, "more": False},
                "acknowledge": ACTIVE | {"acknowledged_by": "zenoh/operator/ground"},
            }[verb]
        )


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> BusDouble:
    bus = BusDouble()
    monkeypatch.setattr("cdff_common.bus.Bus.open", lambda *_, **__: bus)
    return bus


def run(*arguments: str) -> int:
    """Run ``cdff alarms`` with arguments; return the exit code."""
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    args = parser.parse_args(["alarms", *arguments])
    code: int = args.run(args)
    return code


def test_active_alarms_are_listed_with_id_and_remedy(
    bus: BusDouble, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run() == 0
    assert capsys.readouterr().out == (
        "critical disk_full/dpm since 2023-11-14T22:13:20.000000Z: 0 bytes are free; free space\n"
    )
    assert run("--json") == 0
    assert json.loads(capsys.readouterr().out) == ACTIVE


def test_the_history_contains_starts_and_ends(bus: BusDouble, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--all") == 0
    start, end = capsys.readouterr().out.splitlines()
    assert "disk_full/dpm since" in start
    assert end == "critical disk_full/dpm has ended"


def test_an_alarm_is_acknowledged_by_its_id(bus: BusDouble, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("ack", "outbox_in_memory/mana/understudy") == 0
    key = keys.dpm_rpc("ground", "acknowledge")
    assert bus.called == [(key, {"kind": "outbox_in_memory", "source": "mana/understudy"})]
    assert "(acknowledged by zenoh/operator/ground)" in capsys.readouterr().out


def test_a_malformed_id_is_refused() -> None:
    with pytest.raises(InputError, match="'disk_full': expected KIND/SOURCE"):
        run("ack", "disk_full")
