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
#: Younger than the time between two patches, two seconds of mission time: asked at the right moment, it must wait.
MAX_AGE_S = 1.0
WISH = {"robot": "mana", "region": "near:mana/base,3", "max_age_s": MAX_AGE_S, "min_coverage": 0.1}


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
        """The answer or the typed error; fails where there is neither at the deadline."""
        self.join(DEADLINE_S + 3.0)
        assert not self.is_alive(), "no final answer at the deadline"
        assert self.took_s <= DEADLINE_S + 0.5, f"the final answer came after {self.took_s:.1f} s"
        return self.result


def kill_and_wait_back(stage: Stage, bus: Bus, process: str, token: str) -> None:
    """SIGKILL a service and return once another process of it has announced itself, within ``BACK_S``."""
    victim = process_of(stage, process)
    victim.send_signal(signal.SIGKILL)
    killed_s = time.monotonic()

    def is_back() -> bool:
        try:
            return process_of(stage, process).pid != victim.pid and token in bus.alive(token)
        except AssertionError:  # not started again yet
            return False

    while not is_back():
        assert time.monotonic() - killed_s < BACK_S, f"{process} is not back after {BACK_S:g} s"
        time.sleep(0.05)


@pytest.mark.req("CDFF-SUP-041", "CDFF-SUP-043")
@pytest.mark.parametrize(
    ("process", "scope", "service"),
    [
        ("mana_mapping", "mana", "digital_elevation_mapping"),
        ("mana_position", "mana", "position_manager"),
        ("mana_vision", "mana", "visual_odometry_sparse"),
        ("dpm", "ground", "dpm"),
        ("orchestrator", "ground", "orchestrator"),
        ("icu", "ground", "icu"),
        ("router", "ground", "router"),
    ],
)
def test_a_killed_service_is_back_in_time_and_the_waiting_request_gets_its_final_answer(
    stage: Stage, endpoint: str, process: str, scope: str, service: str
) -> None:
    with Bus.open(endpoint, name="test") as bus:
        stage.wait_ready(bus)
        asked = waiting_request(bus, endpoint)
        kill_and_wait_back(stage, bus, process, keys.alive(scope, service))
        result = asked.finished()
        if isinstance(result, CdffError):
            assert isinstance(result, UnavailableError), repr(result)
            assert str(result)
        else:
            assert result.value.geometry.frame == "site"
        stage.wait_ready(bus)
        with Client(endpoint) as client:
            assert client.request("pose", robot="mana", deadline_s=DEADLINE_S).header.child == "mana/base"


def wait_until_old(bus: Bus) -> None:
    """Return when the newest patch of mana is older than what is asked for, so that the store cannot answer."""
    clock, deadline_s = bus.mission_clock, time.monotonic() + 20.0
    while time.monotonic() < deadline_s:
        found = bus.call(keys.dpm_rpc("mana", "search"), {"type": "dem", "limit": 1}).body()["items"]
        if not found or clock.now_ns() - int(found[0]["t1_ns"]) > MAX_AGE_S * 1e9:
            return
        time.sleep(0.05)
    raise AssertionError("patches are never older than what is asked for")


def waiting_request(bus: Bus, endpoint: str) -> Asked:
    """A request that the orchestrator has open and that still waits; asked again where a patch came in between."""
    for _ in range(5):
        wait_until_old(bus)
        asked = Asked(endpoint, "dem", **WISH)
        with Client(endpoint) as client:
            while asked.is_alive():
                if any(job["state"] in {"preparing", "waiting"} for job in client.jobs(limit=3)):
                    return asked
                time.sleep(0.02)
        asked.finished()
    raise AssertionError("five requests in a row were answered at once")
