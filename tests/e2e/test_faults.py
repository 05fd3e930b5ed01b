# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Killed services: a waiting request is answered, or fails with a reason, before its deadline."""

from __future__ import annotations

import signal
import threading
import time
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.errors import CdffError, UnavailableError
from cdff_dev.missions.stage import Stage
from tests.e2e.conftest import process_of

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(240)]

DEADLINE_S = 25.0
#: Time after which a service counts as not restarted; the time that a restart takes depends on the machine.
HUNG_S = 20.0
#: Less than the 2 s of mission time between two patches, so that a request can be made to wait for a patch.
MAX_AGE_S = 1.0
PARAMETERS = {"robot": "mana", "region": "near:mana/base,3", "max_age_s": MAX_AGE_S, "min_coverage": 0.1}


class PendingRequest(threading.Thread):
    """A request that waits in a thread for its answer or error, with its duration ``duration_s``."""

    def __init__(self, endpoint: str, product: str, **parameters: Any) -> None:
        super().__init__(daemon=True)
        self._endpoint, self._product, self._parameters = endpoint, product, parameters
        self.outcome: Any = None
        self.duration_s = 0.0
        self.start()

    def run(self) -> None:
        start_s = time.monotonic()
        try:
            with Client(self._endpoint) as client:
                self.outcome = client.request(self._product, deadline_s=DEADLINE_S, **self._parameters)
        except CdffError as error:
            self.outcome = error
        self.duration_s = time.monotonic() - start_s

    def wait_for_outcome(self) -> Any:
        """Return the answer or the typed error; fail if neither has arrived at the deadline."""
        self.join(DEADLINE_S + 3.0)
        assert not self.is_alive(), "no final answer at the deadline"
        assert self.duration_s <= DEADLINE_S + 0.5, f"the final answer arrived after {self.duration_s:.1f} s"
        return self.outcome


def kill_and_await_restart(stage: Stage, bus: Bus, process: str, token: str) -> None:
    """Send SIGKILL to a service; return when its new process is alive."""
    killed_process = process_of(stage, process)
    killed_process.send_signal(signal.SIGKILL)
    killed_s = time.monotonic()

    def has_restarted() -> bool:
        try:
            return process_of(stage, process).pid != killed_process.pid and token in bus.alive(token)
        except AssertionError:  # the supervisor has not restarted it yet
            return False

    while not has_restarted():
        assert time.monotonic() - killed_s < HUNG_S, f"{process} has not restarted"
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
def test_a_killed_service_restarts_and_the_waiting_request_gets_its_final_reply(
    stage: Stage, endpoint: str, process: str, scope: str, service: str
) -> None:
    with Bus.open(endpoint, name="test") as bus:
        stage.wait_ready(bus)
        request = waiting_request(bus, endpoint)
        kill_and_await_restart(stage, bus, process, keys.alive(scope, service))
        outcome = request.wait_for_outcome()
        if isinstance(outcome, CdffError):
            assert isinstance(outcome, UnavailableError), repr(outcome)
            assert str(outcome)
        else:
            assert outcome.value.geometry.frame == "site"
        stage.wait_ready(bus)
        with Client(endpoint) as client:
            assert client.request("pose", robot="mana", deadline_s=DEADLINE_S).header.child == "mana/base"


def wait_until_old(bus: Bus) -> None:
    """Wait until the newest patch of mana exceeds the requested age, so that the store cannot answer."""
    clock, deadline_s = bus.mission_clock, time.monotonic() + 20.0
    while time.monotonic() < deadline_s:
        patches = bus.call(keys.dpm_rpc("mana", "search"), {"type": "dem", "limit": 1}).body()["items"]
        if not patches or clock.now_ns() - int(patches[0]["t1_ns"]) > MAX_AGE_S * 1e9:
            return
        time.sleep(0.05)
    raise AssertionError("the newest patch never exceeded the requested age")


def waiting_request(bus: Bus, endpoint: str) -> PendingRequest:
    """Return a request that waits in the orchestrator; repeat it if a new patch answered it at once."""
    for _ in range(5):
        wait_until_old(bus)
        request = PendingRequest(endpoint, "dem", **PARAMETERS)
        with Client(endpoint) as client:
            while request.is_alive():
                if any(job["state"] in {"preparing", "waiting"} for job in client.jobs(limit=3)):
                    return request
                time.sleep(0.02)
        request.wait_for_outcome()
    raise AssertionError("five requests in a row were answered at once")
