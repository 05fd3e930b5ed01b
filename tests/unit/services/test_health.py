# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import pytest

from cdff_common.bus import Reply
from cdff_common.errors import DeadlineError, InputError
from services import health


class _Bus:
    def __init__(self, *tokens: str, answer: Any = None) -> None:
        self._tokens, self._answer = set(tokens), answer

    def call(self, key: str, timeout_s: float) -> Reply:
        if self._answer is None:
            raise DeadlineError(f"{key}: no final answer within {timeout_s:g} s")
        return Reply.of(self._answer)

    def alive(self, key: str) -> set[str]:
        return self._tokens & {key}


def test_services_without_a_token_are_named() -> None:
    bus: Any = _Bus("cdff/@v1/ground/@alive/dpm")
    assert health.missing_services(bus, ["ground/dpm", "mana/position_manager"]) == ["mana/position_manager"]


def test_services_that_hang_or_have_a_dead_loop_are_named() -> None:
    hung: Any = _Bus()
    assert "does not answer" in health.unhealthy_services(hung, ["ground/dpm", "mana/position_manager"])[0]
    loops = {"watcher": {"problem": "loop watcher has ended"}, "control": {"problem": ""}}
    dead: Any = _Bus(answer={"loops": loops})
    assert health.unhealthy_services(dead, ["ground/orchestrator"]) == [
        "ground/orchestrator: loop watcher has ended"
    ]


def test_a_gateway_answers_by_its_status() -> None:
    bus: Any = _Bus(answer={"inputs": {}, "outputs": []})
    assert health.unhealthy_services(bus, ["mana/gateway_ros2"]) == []
    hung: Any = _Bus()
    (problem,) = health.unhealthy_services(hung, ["mana/gateway_ros2"])
    assert "cdff/@v1/mana/gateway/gateway_ros2/status" in problem


def test_a_service_without_scope_is_refused() -> None:
    bus: Any = _Bus()
    with pytest.raises(InputError, match="scope"):
        health.missing_services(bus, ["dpm"])


def test_the_health_check_fails_without_a_router(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CDFF_CONNECT", "tcp/127.0.0.1:1")
    assert health.main(["ground/dpm", "--wait-s", "0"]) == 1
    assert health.main(["ground/dpm", "--wait-s", "0", "--without-router"]) == 0
    assert "no Zenoh router answers" in capsys.readouterr().err
