# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator among real processes: router, DPM, ICU, DFPC hosts; only the sensor driver is the test itself."""

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

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.errors import (
    DeadlineError,
    InputError,
    OverloadedError,
    ProductNotFoundError,
    UnavailableError,
)
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import RigidBodyState, TransformWithCovariance
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn, process_starter
from tests.integration.conftest import wait_until as eventually

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")
REQUEST = keys.orchestrator_rpc("mana", "request")


class Driver:
    """Wheel odometry of mana at 50 Hz while the ICU says that the sensor is on."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.on = threading.Event()
        self.trouble = ""
        self.modes: list[str] = []
        self.events: list[str] = []
        self._stop = threading.Event()
        self._seq = 0
        bus.subscribe(keys.event("mana", "sensor_mode"), self._on_mode)
        bus.subscribe(keys.event("mana", "activated"), lambda _m: self.events.append("activated"))
        bus.subscribe(keys.event("mana", "deactivated"), lambda _m: self.events.append("deactivated"))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _on_mode(self, message: Message) -> None:
        body = unpack(message.payload)
        self.modes.append(body["mode"])
        (self.on.set if body["on"] else self.on.clear)()

    def _run(self) -> None:
        while not self._stop.wait(0.02):
            if self.on.is_set():
                self.send(self.trouble or "mana/base")
                self.trouble = ""

    def send(self, child: str) -> None:
        self._seq += 1
        stamp_ns = wall_ns()
        matrix = se3.transform(se3.exp_so3([0, 0, 0.5]), [self._seq * 0.01, 0, 0])
        T = UncertainTransform(matrix, np.eye(6) * 1e-4 + 1e-5)
        value = TransformWithCovariance.from_transform(T, parent="site", child=child, stamp_ns=stamp_ns)
        header = Header(
            product_id("mana", "wheels", "odometry", stamp_ns, self._seq, ""), self._seq, stamp_ns, stamp_ns, "site",
            "wheels", child=child,
        )  # fmt: skip
        self.bus.publish(
            keys.sensor("mana", "wheels", "odometry"), encode(value, "uper"),
            encoding=encoding_string("TransformWithCovariance", "uper"), attachment=header.to_attachment(),
        )  # fmt: skip

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


class System:
    """The processes, by name, so that a test can kill and start them."""

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

    def start(self, name: str, called: str = "") -> None:
        self.processes[called or name] = self._spawn(*self._argv[name])

    def second_orchestrator(self, data: Path) -> str:
        """What another orchestrator says before it ends."""
        log = self.data / "services.orchestrator.log"
        before = log.stat().st_size
        argv = [*self._argv["orchestrator"], "--data-dir", str(data)]
        assert self._spawn(*argv).wait(20) == 1
        return log.read_bytes()[before:].decode()

    def wait_ready(self) -> None:
        """Until every service answers."""
        with Bus.open(self.endpoint, name="test", wait_s=20) as bus:
            wanted = {keys.alive("mana", s) for s in ("dpm", "orchestrator", "icu", "troublemaker")}
            eventually(lambda: wanted <= bus.alive(keys.alive("mana", "*")), 40, "start-up")

    @staticmethod
    def is_idle(bus: Bus) -> bool:
        """Whether the DFPC has let go, the sensor is off again, and what the DPM holds is older than tests ask for."""
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
        made = System(spawn, endpoint, f"127.0.0.1:{free_port()}", folder)
        made.wait_ready()
        yield made


@pytest.fixture
def driver(system: System) -> Iterator[Driver]:
    """The sensor driver; before a test nothing runs and the DFPC has let go."""
    system.wait_ready()
    with Bus.open(system.endpoint, name="driver") as bus:
        made = Driver(bus)
        eventually(lambda: system.is_idle(bus), 20, "an idle system")
        yield made
        made.stop()


@pytest.fixture
def client(system: System, driver: Driver) -> Iterator[Client]:
    with Client(system.endpoint) as made:
        yield made


@pytest.mark.req("CDFF-SUP-020", "CDFF-SUP-022", "CDFF-SUP-024", "CDFF-SUP-027")
def test_a_request_sets_the_mode_activates_the_dfpc_delivers_and_lets_go(
    client: Client, driver: Driver, system: System
) -> None:
    states: list[str] = []
    answer = client.request("pose", robot="mana", max_age_s=0.9, on_progress=lambda body: states.append(body["state"]))
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
def test_what_is_fresh_in_the_dpm_is_served_without_running_anything(client: Client, driver: Driver) -> None:
    first = client.request("pose", robot="mana", max_age_s=0.9)
    eventually(lambda: "deactivated" in driver.events, 15)
    activations = driver.events.count("activated")
    second = client.request("pose", robot="any", max_age_s=600)
    assert driver.events.count("activated") == activations
    assert second.header.t1_ns >= first.header.t1_ns
    assert client.jobs()[0]["plan"] is None


@pytest.mark.req("CDFF-SUP-021", "CDFF-SUP-028")
def test_the_answer_comes_in_the_type_frame_and_encoding_asked_for(client: Client) -> None:
    plain = client.request("pose", robot="mana", max_age_s=600)
    state = client.request("pose", robot="mana", max_age_s=600, as_type="RigidBodyState", format="xer")
    assert isinstance(state.value, RigidBodyState)
    assert (state.value.target_frame, state.value.source_frame) == ("site", "mana/base")
    assert "cross_covariance_dropped" in state.header.quality.reasons
    assert "cross_covariance_dropped" in state.delivered["differences"]
    turned = client.request("pose", robot="mana", max_age_s=600, frame="mana/base", child="site")
    at = client.request("pose", robot="mana", t_ns=turned.header.t1_ns)
    np.testing.assert_allclose(turned.value.transform.matrix @ at.value.transform.matrix, np.eye(4), atol=1e-6)
    wanted = at.value.transform.inverse().covariance
    np.testing.assert_allclose(turned.value.transform.covariance, wanted, rtol=1e-6, atol=1e-12)
    assert plain.type_name == "TransformWithCovariance"
    tum = client.request("pose", robot="mana", max_age_s=600, format="tum")
    assert len(tum.data.split()) == 8


def test_a_reference_is_fetched_by_id(client: Client, system: System) -> None:
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
        with pytest.raises(InputError, match="nobody"):
            bus.call(keys.orchestrator_rpc("ground", "request"), {"type": "pose", "robot": "nobody"})
    with pytest.raises(ProductNotFoundError):
        client.cancel("no-such-job")


def test_a_product_that_nothing_makes_is_refused_at_once_with_what_can_be_made(client: Client) -> None:
    with pytest.raises(UnavailableError, match="pose of mana"):
        client.request("dem", robot="mana", deadline_s=60)


def test_a_mode_that_the_icu_refuses_is_the_reason_given(client: Client) -> None:
    with pytest.raises(UnavailableError, match="turbo"):
        client.request("pose", robot="minnie", deadline_s=8)


@pytest.mark.req("CDFF-SUP-026")
@pytest.mark.req("CDFF-SUP-026")
def test_a_deadline_that_passes_is_answered_before_it_with_the_reason(client: Client, driver: Driver) -> None:
    driver.stop()
    with pytest.raises(DeadlineError, match="pose"):
        client.request("pose", robot="mana", max_age_s=0.1, deadline_s=2)


def test_one_cancelled_request_ends_at_once(client: Client, driver: Driver) -> None:
    driver.stop()
    raised: list[Exception] = []

    def ask() -> None:
        try:
            client.request("pose", robot="mana", max_age_s=0.1, deadline_s=60)
        except UnavailableError as error:
            raised.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    eventually(lambda: client.jobs("mana"))
    client.cancel(client.jobs("mana")[0]["job"])
    thread.join(10)
    assert "cancelled" in str(raised[0])
    assert client.jobs("mana")[0]["state"] == "cancelled"


def test_more_requests_than_there_is_room_for_are_told_so_at_once(client: Client, driver: Driver) -> None:
    driver.stop()

    def ask() -> None:
        with contextlib.suppress(UnavailableError):
            client.request("pose", robot="mana", max_age_s=0.1, deadline_s=8)

    threads = [threading.Thread(target=ask) for _ in range(3)]
    for thread in threads:
        thread.start()
    eventually(lambda: sum(j["remaining_s"] is not None for j in client.jobs("mana")) == 3)
    with pytest.raises(OverloadedError):
        client.request("pose", robot="mana", max_age_s=0.1, deadline_s=8)
    for thread in threads:
        thread.join(20)


@pytest.mark.req("CDFF-SUP-072")
def test_a_request_of_higher_priority_is_taken_in_place_of_the_last_of_lower_priority(
    client: Client, driver: Driver
) -> None:
    driver.stop()
    ended: list[Exception] = []

    def ask() -> None:
        try:
            client.request("pose", robot="mana", max_age_s=0.1, deadline_s=12, priority=1)
        except UnavailableError as error:
            ended.append(error)

    threads = [threading.Thread(target=ask) for _ in range(3)]
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
def test_identical_requests_at_a_time_share_one_activation(client: Client, driver: Driver) -> None:
    before, answers = driver.events.count("activated"), []

    def ask() -> None:
        answers.append(client.request("pose", robot="mana", max_age_s=0.9))

    threads = [threading.Thread(target=ask) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert len(answers) == 3
    assert driver.events.count("activated") == before + 1


@pytest.mark.req("CDFF-SUP-073")
def test_a_standing_request_brings_each_newer_product_until_it_is_closed(client: Client, driver: Driver) -> None:
    came = []
    with contextlib.closing(client.standing("pose", robot="mana", every_s=0.2, lease_s=3.0)) as answers:
        for answer in answers:
            came.append(answer)
            if len(came) == 5:
                break
        stamps = [a.header.t1_ns for a in came]
        assert stamps == sorted(set(stamps))
        assert all(isinstance(a.value, TransformWithCovariance) for a in came)
        assert driver.events[-1] == "activated"
    eventually(lambda: client.jobs("mana")[0]["state"] == "cancelled")
    eventually(lambda: driver.events[-1] == "deactivated", 15, "letting go")


@pytest.mark.req("CDFF-SUP-073")
def test_a_standing_request_outlives_its_first_lease_while_renewed_and_ends_when_it_is_not(
    client: Client, driver: Driver, system: System
) -> None:
    asked = {"type": "pose", "every_s": 0.5, "deadline_ms": 4000, "request": "standing"}
    with Bus.open(system.endpoint, name="raw") as bus:
        start_s, replies, renewed = time.monotonic(), [], False
        for reply in bus.call_stream(REQUEST, asked, timeout_s=30):
            replies.append(reply)
            if reply.attachment["kind"] == "product" and not renewed:
                renewed = True
                bus.call(keys.orchestrator_rpc("mana", "renew"), {"job": "standing", "deadline_ms": 5000})
        assert time.monotonic() - start_s > 4.0, "it was renewed"
    kinds = [r.attachment["kind"] for r in replies]
    assert kinds[-1] == "end"
    assert replies[-1].body()["sent"] == kinds.count("product") > 2
    assert [r.final for r in replies].count(True) == 1
    assert client.jobs("mana")[0]["state"] == "done"


@pytest.mark.req("CDFF-SUP-041")
def test_a_dfpc_killed_while_a_request_waits_is_activated_again_when_it_is_back(
    client: Client, driver: Driver, system: System
) -> None:
    driver.trouble = ""
    client.request("pose", robot="mana", max_age_s=0.9)
    system.kill("host")
    done: list[Any] = []
    since_ns = wall_ns()

    def ask() -> None:
        done.append(client.request("pose", robot="mana", max_age_s=0.5, deadline_s=30))

    thread = threading.Thread(target=ask)
    eventually(lambda: wall_ns() - since_ns > 1_000_000_000)
    thread.start()
    system.start("host")
    thread.join(35)
    assert done
    assert done[0].header.t1_ns > since_ns


@pytest.mark.req("CDFF-SUP-041")
def test_a_killed_orchestrator_finds_its_journal_and_the_client_its_answer(
    client: Client, driver: Driver, system: System
) -> None:
    client.request("pose", robot="mana", max_age_s=0.5)
    before = sum(r["kind"] == "start" for r in system.journal())
    system.kill("orchestrator")
    done: list[Any] = []

    def ask() -> None:
        done.append(client.request("pose", robot="mana", max_age_s=0.9, deadline_s=30))

    thread = threading.Thread(target=ask)
    thread.start()
    system.start("orchestrator")
    thread.join(35)
    assert done
    starts = [r for r in system.journal() if r["kind"] == "start"]
    assert len(starts) == before + 1
    assert starts[-1]["owned"] == ["mana/troublemaker"]
    eventually(lambda: "deactivated" in driver.events, 20, "what the dead one had switched on is switched off")


@pytest.mark.req("CDFF-SUP-041")
def test_without_the_dpm_a_request_fails_with_that_reason_and_works_when_it_is_back(
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


@pytest.mark.req("CDFF-SUP-146")
def test_a_second_orchestrator_exits_says_who_leads_and_leaves_the_journal_alone(
    system: System, tmp_path: Path, client: Client
) -> None:
    before = system.journal()
    leader = f"process {system.processes['orchestrator'].pid} on "
    for data in (system.data / "data", tmp_path):  # on the same journal, and elsewhere for the same robots
        assert leader in system.second_orchestrator(data)
    assert not [r for r in system.journal()[len(before) :] if r["kind"] == "start"]


def test_the_catalogue_says_what_can_be_made_and_why_not(client: Client) -> None:
    catalogue = client.catalogue()
    products = {(p["robot"], p["type"]): p for p in catalogue["products"]}
    assert products["mana", "pose"]["plan"]["order"] == ["mana/troublemaker"]
    assert "not available" in products["minnie", "pose"]["why_not"]
    assert {s["sensor"] for s in catalogue["sensors"]} == {"wheels"}


@pytest.mark.req("CDFF-SUP-070")
def test_an_explanation_says_what_would_be_done_and_runs_nothing(client: Client, driver: Driver) -> None:
    before = (list(driver.events), list(driver.modes), client.jobs("mana"))
    fresh = client.explain("pose", robot="mana", max_age_s=0.001)
    assert fresh["would"] == "make"
    assert fresh["plan"]["order"] == ["mana/troublemaker"]
    assert fresh["plan"]["changes"] == {"mana/wheels": ["off", "nominal"]}
    assert client.explain("pose", robot="mana")["would"] == "serve"
    refused = client.explain("dem", robot="mana")
    assert refused["would"] == "refuse"
    assert refused["possible"] == ["pose of mana"]
    assert (driver.events, driver.modes, client.jobs("mana")) == before
