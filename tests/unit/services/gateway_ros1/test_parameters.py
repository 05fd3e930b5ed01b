# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the server stay in force after another ``configure``, and True is not 1."""

from __future__ import annotations

import threading
import time
from typing import Any

import pytest

from services.gateway_ros1 import parameters
from services.gateway_ros1.parameters import ServerParameters


class _Node:
    """The part of a node that parameters use."""

    name = "/cdff_gateway"

    def __init__(self) -> None:
        self.watchers: dict[str, Any] = {}

    def watch_parameter(self, key: str, on_value: Any) -> None:
        self.watchers[key] = on_value


class _Bus:
    """A bus on which all DFPCs are alive."""

    def watch_alive(self, key: str, on_alive: Any) -> None:
        on_alive(key, True)


class _Dfpc:
    """Parameters of one DFPC."""

    names = ("slam.flag",)

    def __init__(self) -> None:
        self.flag: Any = 1

    def value(self, _: str) -> Any:
        return self.flag

    def set(self, values: dict[str, Any]) -> None:
        self.flag = values["slam.flag"]


def _wait(condition: Any) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def test_a_value_that_configure_resets_is_set_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parameters, "_RETRY_S", 0.01)
    monkeypatch.setattr(parameters, "_CHECK_S", 0.05)
    node, dfpc, stop = _Node(), _Dfpc(), threading.Event()
    values = ServerParameters(node, "mana", dfpc, _Bus())  # type: ignore[arg-type]
    thread = threading.Thread(target=values.retry, args=(stop,))
    thread.start()
    node.watchers["/cdff_gateway/slam/flag"](True)
    _wait(lambda: dfpc.flag is True)  # it was 1
    dfpc.flag = False
    _wait(lambda: dfpc.flag is True)
    stop.set()
    thread.join()
