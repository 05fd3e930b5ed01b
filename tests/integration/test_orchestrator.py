# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator with router, DPM, ICU and DFPC host as real processes; the test is the sensor driver."""

from __future__ import annotations

import contextlib
import json
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.errors import (
    DeadlineError,
    InputError,
    OverloadedError,
    ProductNotFoundError,
    UnavailableError,
)
from cdff_common.types import RigidBodyState, TransformWithCovariance
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn, process_starter
from tests.integration.conftest import wait_until as eventually
from tests.support.wheel_odometry import Driver

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")
REQUEST = keys.orchestrator_rpc("mana", "request")


class System:
    """The processes by name; a test can kill and start them."""

    def __init__(self, spawn: Spawn, endpoint: str, http: str, data: Path) -> None:
        self.endpoint, self.data, self._spawn = endpoint, data, spawn
        self._argv = {
            "router": ("services.router",),
            "dpm": ("services.dpm", "--profile", PROFILE, "--http", http),
            "orchestrator": ("services.orchestrator", "--profile", PROFILE, "--capacity", "3"),
            "icu": ("services.icu", "--profile", PROFILE),
            "host": ("services.dfpc_host", "--profile", PROFILE, "--process", "mana_troublemaker"),
        }
        self.processes = {name: spawn(*argv) for name, argv in self._argv.items()}

    def kill(self, name: str) -> None:
        self.processes[name].send_signal(signal.SIGKILL)
        self.processes[name].wait(5)

    def start(self, name: str, new_name: str = "") -> None:
        self.processes[new_name or name] = self._spawn(*self._argv[name])

    def second_orchestrator(self, data: Path) -> str:
        """Run a second orchestrator until it exits, and return its log."""
        log = self.data / "services.orchestrator.log"
        before = log.stat().st_size
        argv = [*self._argv["orchestrator"], "--data-dir", str(data)]
        assert self._spawn(*argv).wait(20) == 1
        return log.read_bytes()[before:].decode()

    def wait_ready(self) -> None:
        """Wait until every service is alive."""
        with Bus.open(self.endpoint, name="test", wait_s=20) as bus:
            wanted = {keys.alive("mana", s) for s in ("dpm", "orchestrator", "icu", "troublemaker")}
            eventually(lambda: wanted <= bus.alive(keys.alive("mana", "*")), 40, "start-up")

    @staticmethod
    def is_idle(bus: Bus) -> bool:
        """Return True if the DFPC is inactive, the sensor off and the newest stored pose older than 1 s."""
        state = bus.call(keys.dfpc_rpc("mana", "troublemaker", "status")).body()["state"]
        mode = bus.call(keys.icu_rpc("mana", "modes")).body()["sensors"]["wheels"]["mode"]
        poses = bus.call(keys.dpm_rpc("ground", "search"), {"type": "pose", "limit": 1}).body()["items"]
        is_old = not poses or wall_ns() - poses[0]["t1_ns"] > 1_000_000_000
        return bool((state, mode) == ("inactive", "off") and is_old)

    def journal(self) -> list[dict[str, Any]]:
        path = self.data / "data" / "orchestrator" / "journal.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    """One system for all tests of this module: a test that kills a process starts it again."""
    folder, endpoint = tmp_path_factory.mktemp("system"), f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as spawn:
        system = System(spawn, endpoint, f"127.0.0.1:{free_port()}", folder)
        system.wait_ready()
        yield system


@pytest.fixture
def driver(system: System) -> Iterator[Driver]:
    """The sensor driver, started when the system is idle."""
    system.wait_ready()
    with Bus.open(system.endpoint, name="driver") as bus:
        result = Driver(bus)
        eventually(lambda: system.is_idle(bus), 20, "an idle system")
        yield result
        result.stop()


@pytest.fixture
def client(system: System, driver: Driver) -> Iterator[Client]:
    with Client(system.endpoint) as client:
        yield client


@pytest.mark.req("CDFF-SUP-020", "CDFF-SUP-022", "CDFF-SUP-024", "CDFF-SUP-027")
def test_a_request_switches_the_sensor_activates_the_dfpc_is_answered_and_then_releases_both(
    client: Client, driver: Driver, system: System
) -> None:
    states: list[str] = []
    answer = client.request(
        "pose", robot="mana", max_age_s=0.9, on_progress=lambda body: states.append(body["state"])
    )
    assert isinstance(answer.value, TransformWithCovariance)
    assert (answer.value.parent_frame, answer.value.child_frame) == ("site", "mana/base")
    assert answer.delivered["age_s"] <= 0.9
    assert answer.delivered["differences"] == []
    assert answer.header.producer == "troublemaker/Troublemaker/1"
    assert states[0] == "received"
    assert "preparing" in states
    assert driver.modes[0] == "nominal"
    eventually(lambda: "deactivated" in driver.events, 15, "deactivation after the linger time")
    kinds = {r["kind"] for r in system.journal()}
    assert {"start", "job", "lease", "mode", "activation"} <= kinds
    jobs = client.jobs("mana")
    assert jobs[0]["state"] == "done"
    assert jobs[0]["result"]["id"] == answer.header.id


@pytest.mark.req("CDFF-SUP-023")
def test_a_recent_product_of_the_dpm_is_delivered_without_running_a_dfpc(
    client: Client, driver: Driver
) -> None:
    first = client.request("pose", robot="mana", max_age_s=0.9)
    eventually(lambda: "deactivated" in driver.events, 15)
    activations = driver.events.count("activated")
    second = client.request("pose", robot="any", max_age_s=600)
    assert driver.events.count("activated") == activations
    assert second.header.t1_ns >= first.header.t1_ns
    assert client.jobs()[0]["plan"] is None


@pytest.mark.req("CDFF-SUP-021", "CDFF-SUP-028")
def test_the_answer_has_the_requested_type_frame_and_encoding(client: Client) -> None:
    plain = client.request("pose", robot="mana", max_age_s=600)
    state = client.request("pose", robot="mana", max_age_s=600, as_type="RigidBodyState", format="xer")
    assert isinstance(state.value, RigidBodyState)
    assert (state.value.target_frame, state.value.source_frame) == ("site", "mana/base")
    assert "cross_covariance_dropped" in state.header.quality.reasons
    assert "cross_covariance_dropped" in state.delivered["differences"]
    inverse = client.request("pose", robot="mana", max_age_s=600, frame="mana/base", child="site")
    at = client.request("pose", robot="mana", t_ns=inverse.header.t1_ns)
    np.testing.assert_allclose(
        inverse.value.transform.matrix @ at.value.transform.matrix, np.eye(4), atol=1e-6
    )
    wanted = at.value.transform.inverse().covariance
    np.testing.assert_allclose(inverse.value.transform.covariance, wanted, rtol=1e-6, atol=1e-12)
    assert plain.type_name == "TransformWithCovariance"
    tum = client.request("pose", robot="mana", max_age_s=600, format="tum")
    assert len(tum.data.split()) == 8


def test_a_product_delivered_by_reference_is_retrieved_by_id(client: Client, system: System) -> None:
    answer = client.request("pose", robot="mana", max_age_s=600, deliver="reference")
    assert isinstance(answer.value, TransformWithCovariance)
    assert client.get(answer.header.id).value == answer.value
    with Bus.open(system.endpoint, name="raw") as bus:
        reply = bus.call(REQUEST, {"type": "pose", "max_age_s": 600, "deliver": "reference"}, timeout_s=10)
    assert reply.attachment["kind"] == "reference"
    assert reply.body()["id"]


def test_wrong_requests_are_refused_with_the_parameter_named(client: Client, system: System) -> None:
    with Bus.open(system.endpoint, name="raw") as bus:
        with pytest.raises(InputError, match="colour"):
            bus.call(REQUEST, {"type": "pose", "colour": "red"})
        with pytest.raises(ProductNotFoundError, match="stranger"):
            bus.call(keys.orchestrator_rpc("ground", "request"), {"type": "pose", "robot": "stranger"})
    with pytest.raises(ProductNotFoundError):
        client.cancel("no-such-job")


def test_a_product_without_provider_is_refused_at_once_with_the_available_types(client: Client) -> None:
    with pytest.raises(UnavailableError, match="pose of mana"):
        client.request("dem", robot="mana", deadline_s=60)


def test_a_mode_refused_by_the_icu_is_the_reported_reason(client: Client) -> None:
    with pytest.raises(UnavailableError, match="turbo"):
        client.request("pose", robot="minnie", deadline_s=8)


@pytest.mark.req("CDFF-SUP-026")
@pytest.mark.req("CDFF-SUP-026")
def test_a_missed_deadline_is_answered_in_time_with_the_reason(client: Client, driver: Driver) -> None:
    driver.stop()
    with pytest.raises(DeadlineError, match="pose"):
        client.request("pose", robot="mana", max_age_s=0.1, deadline_s=2)


def test_a_cancelled_request_ends_at_once(client: Client, driver: Driver) -> None:
    driver.stop()
    raised: list[Exception] = []

    def request() -> None:
        try:
            client.request("pose", robot="mana", max_age_s=0.1, deadline_s=60)
        except UnavailableError as error:
            raised.append(error)

    thread = threading.Thread(target=request)
    thread.start()
    eventually(lambda: client.jobs("mana"))
    client.cancel(client.jobs("mana")[0]["job"])
    thread.join(10)
    assert "cancelled" in str(raised[0])
    assert client.jobs("mana")[0]["state"] == "cancelled"


@pytest.mark.slow
def test_requests_beyond_the_capacity_are_refused_at_once(client: Client, driver: Driver) -> None:
    driver.stop()

    def request() -> None:
        with contextlib.suppress(UnavailableError):
            client.request("pose", robot="mana", max_age_s=0.1, deadline_s=8)

    threads = [threading.Thread(target=request) for _ in range(3)]
    for thread in threads:
        thread.start()
    eventually(lambda: sum(j["remaining_s"] is not None for j in client.jobs("mana")) == 3)
    with pytest.raises(OverloadedError):
        client.request("pose", robot="mana", max_age_s=0.1, deadline_s=8)
    for thread in threads:
        thread.join(20)


@pytest.mark.req("CDFF-SUP-072")
@pytest.mark.slow
def test_a_request_of_higher_priority_replaces_the_last_one_of_lower_priority(
    client: Client, driver: Driver
) -> None:
    driver.stop()
    ended: list[Exception] = []

    def request() -> None:
        try:
            client.request("pose", robot="mana", max_age_s=0.1, deadline_s=12, priority=1)
        except UnavailableError as error:
            ended.append(error)

    threads = [threading.Thread(target=request) for _ in range(3)]
    for thread in threads:
        thread.start()
    eventually(lambda: sum(j["remaining_s"] is not None for j in client.jobs("mana")) == 3)
    with pytest.raises(DeadlineError):
        client.request("pose", robot="mana", max_age_s=0.1, deadline_s=1, priority=9)
    eventually(lambda: [e for e in ended if isinstance(e, OverloadedError)])
    for thread in threads:
        thread.join(20)
    assert sorted(type(e).__name__ for e in ended) == ["DeadlineError", "DeadlineError", "OverloadedError"]


@pytest.mark.req("CDFF-SUP-071")
def test_identical_concurrent_requests_share_one_activation(client: Client, driver: Driver) -> None:
    before, answers = driver.events.count("activated"), []

    def request() -> None:
        answers.append(client.request("pose", robot="mana", max_age_s=0.9))

    threads = [threading.Thread(target=request) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert len(answers) == 3
    assert driver.events.count("activated") == before + 1


@pytest.mark.req("CDFF-SUP-073")
def test_a_standing_request_delivers_each_newer_product_until_it_is_closed(
    client: Client, driver: Driver
) -> None:
    received = []
    with contextlib.closing(client.standing("pose", robot="mana", every_s=0.2, lease_s=3.0)) as answers:
        for answer in answers:
            received.append(answer)
            if len(received) == 5:
                break
        stamps = [a.header.t1_ns for a in received]
        assert stamps == sorted(set(stamps))
        assert all(isinstance(a.value, TransformWithCovariance) for a in received)
        assert driver.events[-1] == "activated"
    eventually(lambda: client.jobs("mana")[0]["state"] == "cancelled")
    eventually(lambda: driver.events[-1] == "deactivated", 15, "the deactivation")


@pytest.mark.req("CDFF-SUP-073")
@pytest.mark.slow
def test_a_standing_request_continues_while_renewed_and_then_ends(
    client: Client, driver: Driver, system: System
) -> None:
    parameters = {"type": "pose", "every_s": 0.5, "deadline_ms": 4000, "request": "standing"}
    with Bus.open(system.endpoint, name="raw") as bus:
        start_s, replies, renewed = time.monotonic(), [], False
        for reply in bus.call_stream(REQUEST, parameters, timeout_s=30):
            replies.append(reply)
            if reply.attachment["kind"] == "product" and not renewed:
                renewed = True
                bus.call(keys.orchestrator_rpc("mana", "renew"), {"job": "standing", "deadline_ms": 5000})
        assert time.monotonic() - start_s > 4.0, "the request was not renewed"
    kinds = [r.attachment["kind"] for r in replies]
    assert kinds[-1] == "end"
    assert replies[-1].body()["sent"] == kinds.count("product") > 2
    assert [r.final for r in replies].count(True) == 1
    assert client.jobs("mana")[0]["state"] == "done"


@pytest.mark.req("CDFF-SUP-041")
def test_a_dfpc_killed_during_a_request_is_activated_again_after_its_restart(
    client: Client, driver: Driver, system: System
) -> None:
    driver.next_child = ""
    client.request("pose", robot="mana", max_age_s=0.9)
    system.kill("host")
    answers: list[Any] = []
    since_ns = wall_ns()

    def request() -> None:
        answers.append(client.request("pose", robot="mana", max_age_s=0.5, deadline_s=30))

    thread = threading.Thread(target=request)
    eventually(lambda: wall_ns() - since_ns > 1_000_000_000)
    thread.start()
    system.start("host")
    thread.join(35)
    assert answers
    assert answers[0].header.t1_ns > since_ns


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-041")
def test_a_killed_orchestrator_resumes_from_its_journal_and_the_client_is_answered(
    client: Client, driver: Driver, system: System
) -> None:
    client.request("pose", robot="mana", max_age_s=0.5)
    before = sum(r["kind"] == "start" for r in system.journal())
    system.kill("orchestrator")
    answers: list[Any] = []

    def request() -> None:
        answers.append(client.request("pose", robot="mana", max_age_s=0.9, deadline_s=30))

    thread = threading.Thread(target=request)
    thread.start()
    system.start("orchestrator")
    thread.join(35)
    assert answers
    starts = [r for r in system.journal() if r["kind"] == "start"]
    assert len(starts) == before + 1
    assert starts[-1]["owned"] == ["mana/troublemaker"]
    eventually(
        lambda: "deactivated" in driver.events,
        20,
        "deactivation of what the killed orchestrator had activated",
    )


@pytest.mark.req("CDFF-SUP-041")
@pytest.mark.slow
def test_without_the_dpm_a_request_fails_with_that_reason_until_the_dpm_is_back(
    client: Client, system: System
) -> None:
    system.kill("dpm")
    with pytest.raises(UnavailableError, match="DPM"):
        client.request("pose", robot="mana", max_age_s=5, deadline_s=3)
    system.start("dpm")
    assert client.request("pose", robot="mana", max_age_s=5, deadline_s=30).value is not None


@pytest.mark.req("CDFF-SUP-043")
def test_after_the_router_was_restarted_requests_are_answered_again(client: Client, system: System) -> None:
    system.kill("router")
    system.start("router")
    assert client.request("pose", robot="mana", max_age_s=0.9, deadline_s=30).value is not None


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-146")
def test_a_second_orchestrator_exits_names_the_leader_and_leaves_the_journal_unchanged(
    system: System, tmp_path: Path, client: Client
) -> None:
    before = system.journal()
    leader = f"process {system.processes['orchestrator'].pid} on "
    for data in (
        system.data / "data",
        tmp_path,
    ):  # with the same journal; with another journal for the same robots
        assert leader in system.second_orchestrator(data)
    assert not [r for r in system.journal()[len(before) :] if r["kind"] == "start"]


def test_the_catalogue_states_the_available_products_and_the_reasons_of_the_others(client: Client) -> None:
    catalogue = client.catalogue()
    products = {(p["robot"], p["type"]): p for p in catalogue["products"]}
    assert products["mana", "pose"]["plan"]["order"] == ["mana/troublemaker"]
    assert "not available" in products["minnie", "pose"]["why_not"]
    assert {s["sensor"] for s in catalogue["sensors"]} == {"wheels"}


@pytest.mark.req("CDFF-SUP-070")
def test_an_explanation_states_the_plan_and_runs_nothing(client: Client, driver: Driver) -> None:
    before = (list(driver.events), list(driver.modes), client.jobs("mana"))
    new = client.explain("pose", robot="mana", max_age_s=0.001)
    assert new["would"] == "make"
    assert new["plan"]["order"] == ["mana/troublemaker"]
    assert new["plan"]["changes"] == {"mana/wheels": ["off", "nominal"]}
    assert client.explain("pose", robot="mana")["would"] == "serve"
    refused = client.explain("dem", robot="mana")
    assert refused["would"] == "refuse"
    assert refused["possible"] == ["pose of mana"]
    assert (driver.events, driver.modes, client.jobs("mana")) == before
