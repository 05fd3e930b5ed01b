# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import pytest

from cdff_common.errors import InputError
from services import health


class _Bus:
    def __init__(self, *tokens: str) -> None:
        self._tokens = set(tokens)

    def alive(self, key: str) -> set[str]:
        return self._tokens & {key}


def test_services_without_a_token_are_named() -> None:
    bus: Any = _Bus("cdff/@v1/ground/@alive/dpm")
    assert health.missing_services(bus, ["ground/dpm", "mana/position_manager"]) == ["mana/position_manager"]


def test_a_service_without_scope_is_refused() -> None:
    bus: Any = _Bus()
    with pytest.raises(InputError, match="scope"):
        health.missing_services(bus, ["dpm"])


def test_the_health_check_fails_without_a_router(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CDFF_CONNECT", "tcp/127.0.0.1:1")
    assert health.main(["ground/dpm", "--wait-s", "0"]) == 1
    assert "no Zenoh router answers" in capsys.readouterr().err
