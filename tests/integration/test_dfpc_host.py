# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DFPC host as a process: ports, life cycle, faults it survives."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.errors import CdffError, InputError, NotActiveError, ProductNotFoundError, UnavailableError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import TransformWithCovariance
from services.dfpc_host.host import EXIT_HUNG
from tests.integration.conftest import Eventually, Spawn

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "troublemaker.yaml")
INPUT = keys.sensor("mana", "wheels", "odometry")
NAME = "troublemaker"


class Robot:
    """The other side: publishes poses, sees products, asks."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.products: list[Message] = []
        self.events: list[tuple[str, dict[str, Any]]] = []
        self._seq = 0
        bus.subscribe(keys.product("mana", NAME, "echo"), self.products.append, depth=1000)
        bus.subscribe(keys.event("mana", "*"), lambda m: self.events.append((m.key.rsplit("/", 1)[1], decode_map(m))))

    def rpc(self, verb: str, parameters: dict[str, Any] | None = None) -> Any:
        return self.bus.call(keys.dfpc_rpc("mana", NAME, verb), parameters, timeout_s=5).body()

    def send(self, child: str = "mana/base", x: float = 0.0) -> Header:
        self._seq += 1
        stamp_ns = self._seq * 1_000_000
        value = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(np.eye(3), [x, 0, 0])), parent="site", child=child, stamp_ns=stamp_ns
        )
        header = Header(
            id=product_id("mana", "wheels", "odometry", stamp_ns, self._seq, ""),
            seq=self._seq,
            t0_ns=stamp_ns,
            t1_ns=stamp_ns,
            frame="site",
            child=child,
            producer="wheels",
        )
        self.bus.publish(
            INPUT,
            encode(value, "uper"),
            encoding=encoding_string("TransformWithCovariance", "uper"),
            attachment=header.to_attachment(),
        )
        return header

    def ready(self) -> bool:
        return keys.alive("mana", NAME) in self.bus.alive(keys.alive("mana", "*"))

    def state(self) -> str:
        try:
            return str(self.rpc("status")["state"])
        except UnavailableError:
            return "away"


def decode_map(message: Message) -> dict[str, Any]:
    from cdff_common.bus.message import unpack

    body = unpack(message.payload)
    assert isinstance(body, dict)
    return body


@pytest.fixture
def host(router: subprocess.Popen[bytes], spawn: Spawn) -> subprocess.Popen[bytes]:
    return spawn("services.dfpc_host", "--profile", PROFILE, "--process", f"mana_{NAME}")


@pytest.fixture
def robot(host: subprocess.Popen[bytes], endpoint: str, eventually: Eventually) -> Iterator[Robot]:
    with Bus.open(endpoint, name="robot", wait_s=10) as bus:
        made = Robot(bus)
        eventually(made.ready, timeout_s=20)
        yield made


@pytest.fixture
def active(robot: Robot, eventually: Eventually) -> Robot:
    """An active DFPC whose subscription is known to be there."""
    assert robot.rpc("activate") == {"state": "active"}

    def echoed() -> bool:
        robot.send()
        return bool(robot.products)

    eventually(echoed)
    return robot


def drained(robot: Robot) -> Callable[[], bool]:
    return lambda: robot.rpc("status")["pending"] == 0


def test_it_says_what_it_is_and_starts_inactive(robot: Robot) -> None:
    described = robot.rpc("describe")
    assert described["state"] == "inactive"
    assert described["inputs"][0] == {
        "port": "poses",
        "type": "TransformWithCovariance",
        "optional": False,
        "source": "sensor/wheels/odometry",
    }
    assert described["outputs"][0]["product"] == "pose"
    assert described["outputs"][0]["key"] == keys.product("mana", NAME, "echo")


def test_an_inactive_dfpc_takes_nothing(robot: Robot) -> None:
    robot.send()
    assert robot.rpc("status")["samples"] == 0


@pytest.mark.req("CDFF-SUP-015")
def test_products_carry_provenance_and_the_value(active: Robot, eventually: Eventually) -> None:
    sent = active.send(x=7.0)

    def arrived() -> list[Message]:
        return [m for m in active.products if Header.from_attachment(m.attachment).inputs == (sent.id,)]

    eventually(arrived)
    message = arrived()[0]
    header = Header.from_attachment(message.attachment)
    assert message.encoding == "application/vnd.cdff+uper;TransformWithCovariance/1"
    assert header.producer == "troublemaker/Troublemaker/1"
    assert decode("TransformWithCovariance", message.payload, "uper").transform.matrix[0, 3] == 7.0


@pytest.mark.req("CDFF-SUP-012", "CDFF-SUP-013")
def test_the_local_store_and_operations_are_asked_by_key(active: Robot, eventually: Eventually) -> None:
    reply = active.bus.call(keys.dfpc_store("mana", NAME, "last"))
    header = Header.from_dict(reply.attachment)
    assert (header.frame, header.child, header.producer) == ("site", "mana/base", "troublemaker/Troublemaker/1")
    assert decode("TransformWithCovariance", reply.payload, "uper").parent_frame == "site"
    assert active.rpc("call/count", {"factor": 0}) == 0
    with pytest.raises(ProductNotFoundError, match="offers last"):
        active.bus.call(keys.dfpc_store("mana", NAME, "first"))
    for verb in ("call/count", "status", "describe", "activate"):
        with pytest.raises(InputError, match="unknown parameter"):
            active.rpc(verb, {"x": 1})
    with pytest.raises(InputError, match="no verb 'dance'"):
        active.rpc("dance")


def test_deactivation_stops_it_and_is_announced(active: Robot, eventually: Eventually) -> None:
    assert active.rpc("deactivate") == {"state": "inactive"}
    assert active.rpc("deactivate") == {"state": "inactive"}
    eventually(lambda: any(kind == "deactivated" for kind, _ in active.events))
    before = active.rpc("status")["samples"]
    active.send()
    assert active.rpc("status")["samples"] == before


@pytest.mark.req("CDFF-SUP-042")
def test_malformed_bytes_are_counted_and_do_no_harm(active: Robot, eventually: Eventually) -> None:
    good = active.send().to_attachment()
    encoding = encoding_string("TransformWithCovariance", "uper")
    value = b"\x00" * 20
    for payload, named, attachment in [
        (value, encoding, b"nonsense"),
        (b"", encoding, good),
        (b"\xff" * 7, encoding, good),
        (value, "text/plain", good),
        (value, encoding_string("Pointcloud", "uper"), good),
    ]:
        active.bus.publish(INPUT, payload, encoding=named, attachment=attachment)
    eventually(lambda: active.rpc("status")["malformed"] == 5)
    assert active.state() == "active"
    before = len(active.products)
    active.send()
    eventually(lambda: len(active.products) > before)


def test_a_refused_sample_is_counted_and_the_next_one_is_taken(active: Robot, eventually: Eventually) -> None:
    active.send("trouble/refuse")
    eventually(lambda: active.rpc("status")["errors"] == 1)
    assert "told to refuse" in active.rpc("status")["last_error"]
    assert active.state() == "active"


@pytest.mark.req("CDFF-SUP-042")
def test_a_dfpc_that_raises_goes_to_error_says_why_and_comes_back_when_activated(
    active: Robot, eventually: Eventually
) -> None:
    active.send("trouble/raise")
    eventually(lambda: active.state() == "error")
    assert "ZeroDivisionError: told to raise" in active.rpc("status")["last_error"]
    eventually(lambda: any(kind == "alarm" and "told to raise" in body["reason"] for kind, body in active.events))
    with pytest.raises(NotActiveError):
        active.rpc("deactivate")
    assert active.rpc("activate") == {"state": "active"}
    before = len(active.products)

    def echoed() -> bool:
        active.send()
        return len(active.products) > before

    eventually(echoed)


@pytest.mark.req("CDFF-SUP-042")
def test_a_dfpc_that_hangs_ends_its_process_for_the_supervisor_to_start_it_again(
    active: Robot, host: subprocess.Popen[bytes], eventually: Eventually
) -> None:
    active.send("trouble/hang")
    eventually(lambda: host.poll() == EXIT_HUNG, timeout_s=10)
    assert any(kind == "alarm" and "longer than 1 s" in body["reason"] for kind, body in active.events)
    eventually(lambda: not active.ready())


@pytest.mark.req("CDFF-SUP-040")
def test_a_full_queue_drops_the_oldest_counts_each_and_answers_meanwhile(active: Robot, eventually: Eventually) -> None:
    def accounted() -> int:
        status = active.rpc("status")
        return int(status["samples"]) + int(status["dropped"]) + int(status["pending"])

    eventually(drained(active))
    before = accounted()
    for _ in range(120):
        active.send("trouble/slow")
    assert active.rpc("status")["state"] == "active"
    eventually(lambda: active.rpc("status")["dropped"] > 0)
    eventually(lambda: accounted() == before + 120, timeout_s=20)


def test_a_failed_result_is_published_without_payload(active: Robot, eventually: Eventually) -> None:
    active.send("trouble/fail")
    eventually(lambda: active.products[-1].payload == b"")
    header = Header.from_attachment(active.products[-1].attachment)
    assert header.quality.status == "FAILED"
    assert header.quality.reasons == ("told_to_fail",)


def test_without_a_dpm_products_wait_in_the_outbox(active: Robot) -> None:
    status = active.rpc("status")
    assert status["outbox_pending"] >= 1
    assert status["outbox_dropped"] == 0


def test_an_unknown_parameter_of_configure_is_refused_and_changes_nothing(robot: Robot) -> None:
    from cdff_common.bus.message import pack

    with pytest.raises(CdffError, match="Known keys"):
        robot.bus.call(keys.dfpc_rpc("mana", NAME, "configure"), payload=pack({"speed": 1}))
    assert robot.rpc("activate") == {"state": "active"}


@pytest.mark.req("CDFF-SUP-044")
def test_sigterm_ends_it_at_once_also_during_start_up(
    router: subprocess.Popen[bytes], spawn: Spawn, robot: Robot, host: subprocess.Popen[bytes]
) -> None:
    starting = spawn("services.dfpc_host", "--profile", PROFILE, "--process", f"mana_{NAME}")
    starting.terminate()
    assert starting.wait(5) in (0, -15)
    host.terminate()
    assert host.wait(5) == 0


@pytest.mark.req("CDFF-SUP-044")
@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("services.dpm", ("--http", "127.0.0.1:0")),
        ("services.orchestrator", ("--profile", PROFILE)),
        ("services.icu", ("--profile", PROFILE)),
        ("services.dfpc_host", ("--profile", PROFILE, "--process", f"mana_{NAME}")),
    ],
)
def test_sigterm_ends_a_service_that_waits_for_its_router(
    spawn: Spawn, tmp_path: Path, module: str, arguments: tuple[str, ...], eventually: Eventually
) -> None:
    waiting = spawn(module, *arguments)
    log = tmp_path / f"{module}.log"
    # Long enough to be past the imports, where the handler is not there yet and the default ends it.
    eventually(lambda: log.exists() and waiting.poll() is None and _catches_sigterm(waiting.pid), timeout_s=20)
    waiting.terminate()
    assert waiting.wait(5) == 0, log.read_text(encoding="utf-8")


def _catches_sigterm(pid: int) -> bool:
    """Whether a process has a handler for SIGTERM (bit 14 of SigCgt)."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("SigCgt:"):
            return bool(int(line.split()[1], 16) >> 14 & 1)
    return False
