# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Services are killed while a request waits: it is answered, or failed with a reason, before its deadline."""

from __future__ import annotations

import signal
import threading
import time
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.errors import CdffError, UnavailableError
from cdff_dev.demo.stage import Stage
from tests.e2e.conftest import process_of

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(240)]

DEADLINE_S = 25.0
BACK_S = 5.0


class Asked(threading.Thread):
    """A request in flight: its answer or its error, and how long it took."""

    def __init__(self, endpoint: str, product: str, **wishes: Any) -> None:
        super().__init__(daemon=True)
        self._endpoint, self._product, self._wishes = endpoint, product, wishes
        self.result: Any = None
        self.took_s = 0.0
        self.start()

    def run(self) -> None:
        begin_s = time.monotonic()
        try:
            with Client(self._endpoint) as client:
                self.result = client.request(self._product, deadline_s=DEADLINE_S, **self._wishes)
        except CdffError as error:
            self.result = error
        self.took_s = time.monotonic() - begin_s

    def finished(self) -> Any:
        """The answer or the typed error; fails where there is neither shortly after the deadline."""
        self.join(DEADLINE_S + 3.0)
        assert not self.is_alive(), "no final answer at the deadline"
        return self.result


def wait_back(bus: Bus, token: str, limit_s: float) -> float:
    """Seconds until a service has announced itself again."""
    begin_s = time.monotonic()
    while token in bus.alive(token) and time.monotonic() - begin_s < 2.0:
        time.sleep(0.02)  # its death has not been noticed yet
    while token not in bus.alive(token):
        assert time.monotonic() - begin_s < limit_s, f"{token} is not back after {limit_s:g} s"
        time.sleep(0.05)
    return time.monotonic() - begin_s


@pytest.mark.req("CDFF-SUP-041")
@pytest.mark.parametrize(
    ("process", "scope", "service"),
    [
        ("mana_mapping", "mana", "digital_elevation_mapping"),
        ("mana_position", "mana", "position_manager"),
        ("dpm", "ground", "dpm"),
        ("orchestrator", "ground", "orchestrator"),
        ("icu", "ground", "icu"),
    ],
)
def test_a_killed_service_is_back_in_time_and_the_request_gets_its_final_answer(
    stage: Stage, endpoint: str, process: str, scope: str, service: str
) -> None:
    with Bus.open(endpoint, name="test") as bus:
        stage.wait_ready(bus)
        asked = Asked(endpoint, "dem", robot="mana", region="near:mana/base,3", max_age_s=8.0, min_coverage=0.1)
        time.sleep(0.3)
        process_of(stage, process).send_signal(signal.SIGKILL)
        wait_back(bus, keys.alive(scope, service), BACK_S)
        result = asked.finished()
        if isinstance(result, CdffError):
            assert isinstance(result, UnavailableError), repr(result)
            assert str(result)
        else:
            assert result.value.geometry.frame == "site"
        stage.wait_ready(bus)
        with Client(endpoint) as client:
            assert client.request("pose", robot="mana", deadline_s=DEADLINE_S).header.child == "mana/base"


@pytest.mark.req("CDFF-SUP-043")
def test_after_the_router_was_killed_every_service_is_reached_again(stage: Stage, endpoint: str) -> None:
    process_of(stage, "router").send_signal(signal.SIGKILL)
    time.sleep(0.5)
    with Bus.open(endpoint, name="test", wait_s=10) as bus:
        stage.wait_ready(bus)
        with Client(endpoint) as client:
            assert client.request("pose", robot="minnie", deadline_s=DEADLINE_S).header.child == "minnie/base"
