# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DFPC host as a process: ports, life cycle, and the faults that it survives."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode, encode, encoding_string
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
    """The peer of the host: publishes poses, receives products and events, calls operations."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.products: list[Message] = []
        self.events: list[tuple[str, dict[str, Any]]] = []
        self._seq = 0
        bus.subscribe(keys.product("mana", NAME, "echo"), self.products.append, depth=1000)
        bus.subscribe(
            keys.event("mana", "*"), lambda m: self.events.append((m.key.rsplit("/", 1)[1], decode_map(m)))
        )

    def rpc(self, verb: str, parameters: dict[str, Any] | None = None) -> Any:
        return self.bus.call(keys.dfpc_rpc("mana", NAME, verb), parameters, timeout_s=5).body()

    def send(self, child: str = "mana/base", x: float = 0.0) -> Header:
        self._seq += 1
        stamp_ns = self._seq * 1_000_000
        value = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(np.eye(3), [x, 0, 0])),
            parent="site",
            child=child,
            stamp_ns=stamp_ns,
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
            return "unavailable"


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
        result = Robot(bus)
        eventually(result.ready, timeout_s=20)
        yield result


@pytest.fixture
def active(robot: Robot, eventually: Eventually) -> Robot:
    """The robot after its DFPC was activated and has echoed a first pose."""
    assert robot.rpc("activate")["state"] == "active"

    def has_echoed() -> bool:
        robot.send()
        return bool(robot.products)

    eventually(has_echoed)
    return robot


def queue_is_empty(robot: Robot) -> Callable[[], bool]:
    return lambda: robot.rpc("status")["pending"] == 0


def test_a_host_describes_its_dfpc_and_starts_inactive(robot: Robot) -> None:
    description = robot.rpc("describe")
    assert description["state"] == "inactive"
    assert description["inputs"][0] == {
        "port": "poses",
        "type": "TransformWithCovariance",
        "optional": False,
        "source": "sensor/wheels/odometry",
    }
    assert description["outputs"][0]["product"] == "pose"
    assert description["outputs"][0]["key"] == keys.product("mana", NAME, "echo")


def test_an_inactive_dfpc_accepts_no_samples(robot: Robot) -> None:
    robot.send()
    assert robot.rpc("status")["samples"] == 0


@pytest.mark.req("CDFF-SUP-015")
def test_products_carry_provenance_and_the_value(active: Robot, eventually: Eventually) -> None:
    sent = active.send(x=7.0)

    def products_of_pose() -> list[Message]:
        return [m for m in active.products if Header.from_attachment(m.attachment).inputs == (sent.id,)]

    eventually(products_of_pose)
    message = products_of_pose()[0]
    header = Header.from_attachment(message.attachment)
    assert message.encoding == "application/vnd.cdff+uper;TransformWithCovariance/1"
    assert header.producer == "troublemaker/Troublemaker/1"
    assert decode("TransformWithCovariance", message.payload, "uper").transform.matrix[0, 3] == 7.0


@pytest.mark.req("CDFF-SUP-012", "CDFF-SUP-013")
def test_the_local_store_and_operations_are_available_by_key(active: Robot, eventually: Eventually) -> None:
    reply = active.bus.call(keys.dfpc_store("mana", NAME, "last"))
    header = Header.from_dict(reply.attachment)
    assert (header.frame, header.child, header.producer) == (
        "site",
        "mana/base",
        "troublemaker/Troublemaker/1",
    )
    assert decode("TransformWithCovariance", reply.payload, "uper").parent_frame == "site"
    assert active.rpc("call/count", {"factor": 0}) == 0
    with pytest.raises(ProductNotFoundError, match="offers last"):
        active.bus.call(keys.dfpc_store("mana", NAME, "first"))
    for verb in ("call/count", "status", "describe", "activate"):
        with pytest.raises(InputError, match="unknown parameter"):
            active.rpc(verb, {"x": 1})
    with pytest.raises(InputError, match="no verb 'dance'"):
        active.rpc("dance")


def test_deactivation_stops_the_dfpc_and_is_announced(active: Robot, eventually: Eventually) -> None:
    assert active.rpc("deactivate")["state"] == "inactive"
    assert active.rpc("deactivate")["state"] == "inactive"
    eventually(lambda: any(kind == "deactivated" for kind, _ in active.events))
    before = active.rpc("status")["samples"]
    active.send()
    assert active.rpc("status")["samples"] == before


@pytest.mark.req("CDFF-SUP-042")
def test_malformed_bytes_are_counted_and_ignored(active: Robot, eventually: Eventually) -> None:
    valid_attachment = active.send().to_attachment()
    encoding = encoding_string("TransformWithCovariance", "uper")
    value = b"\x00" * 20
    for payload, message_encoding, attachment in [
        (value, encoding, b"nonsense"),
        (b"", encoding, valid_attachment),
        (b"\xff" * 7, encoding, valid_attachment),
        (value, "text/plain", valid_attachment),
        (value, encoding_string("Pointcloud", "uper"), valid_attachment),
    ]:
        active.bus.publish(INPUT, payload, encoding=message_encoding, attachment=attachment)
    eventually(lambda: active.rpc("status")["malformed"] == 5)
    assert active.state() == "active"
    before = len(active.products)
    active.send()
    eventually(lambda: len(active.products) > before)


def test_a_refused_sample_is_counted_and_the_next_one_is_processed(
    active: Robot, eventually: Eventually
) -> None:
    active.send("trouble/refuse")
    eventually(lambda: active.rpc("status")["errors"] == 1)
    assert "refusal on command" in active.rpc("status")["last_error"]
    assert active.state() == "active"


@pytest.mark.req("CDFF-SUP-042")
def test_a_dfpc_that_raises_enters_error_with_its_reason_and_recovers_on_activation(
    active: Robot, eventually: Eventually
) -> None:
    active.send("trouble/raise")
    eventually(lambda: active.state() == "error")
    assert "internal error (ZeroDivisionError)" in active.rpc("status")["last_error"]
    eventually(
        lambda: any(kind == "alarm" and "ZeroDivisionError" in body["reason"] for kind, body in active.events)
    )
    with pytest.raises(NotActiveError):
        active.rpc("deactivate")
    assert active.rpc("activate")["state"] == "active"
    before = len(active.products)

    def has_echoed() -> bool:
        active.send()
        return len(active.products) > before

    eventually(has_echoed)


@pytest.mark.req("CDFF-SUP-042")
def test_a_dfpc_that_hangs_ends_its_process(
    active: Robot, host: subprocess.Popen[bytes], eventually: Eventually
) -> None:
    active.send("trouble/hang")
    eventually(lambda: host.poll() == EXIT_HUNG, timeout_s=10)
    assert any(kind == "alarm" and "without computing" in body["reason"] for kind, body in active.events)
    eventually(lambda: not active.ready())


@pytest.mark.req("CDFF-SUP-040")
def test_a_full_queue_drops_and_counts_the_oldest_samples_and_calls_are_still_answered(
    active: Robot, eventually: Eventually
) -> None:
    def counted_samples() -> int:
        status = active.rpc("status")
        return int(status["samples"]) + int(status["dropped"]) + int(status["pending"])

    eventually(queue_is_empty(active))
    before = counted_samples()
    for _ in range(120):
        active.send("trouble/slow")
    assert active.rpc("status")["state"] == "active"
    eventually(lambda: active.rpc("status")["dropped"] > 0)
    eventually(lambda: counted_samples() == before + 120, timeout_s=20)


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
    assert robot.rpc("activate")["state"] == "active"


def test_configure_does_not_overwrite_a_configuration_that_the_client_has_not_read(robot: Robot) -> None:
    from cdff_common.bus.message import pack

    key = keys.dfpc_rpc("mana", NAME, "configure")
    read = robot.rpc("describe")
    changed = {**read["parameters"], "covariance_factor": 2.0}
    robot.bus.call(key, {"if_match": read["config_hash"]}, payload=pack(changed))
    with pytest.raises(InputError, match="describe the DFPC again"):
        robot.bus.call(key, {"if_match": read["config_hash"]}, payload=pack(read["parameters"]))
    assert robot.rpc("describe")["parameters"]["covariance_factor"] == 2.0
    with pytest.raises(InputError, match=r"unknown parameter 'revision'; expected if_match"):
        robot.rpc("configure", {"revision": 3})


@pytest.mark.req("CDFF-SUP-044")
def test_sigterm_ends_a_running_host_and_a_starting_host_at_once(
    router: subprocess.Popen[bytes], spawn: Spawn, robot: Robot, host: subprocess.Popen[bytes]
) -> None:
    starting_host = spawn("services.dfpc_host", "--profile", PROFILE, "--process", f"mana_{NAME}")
    starting_host.terminate()
    assert starting_host.wait(5) in (0, -15)
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
    service = spawn(module, *arguments)
    log = tmp_path / f"{module}.log"
    # Before its imports have ended, the service has no handler and SIGTERM would end it with -15.
    eventually(
        lambda: log.exists() and service.poll() is None and _catches_sigterm(service.pid), timeout_s=20
    )
    service.terminate()
    assert service.wait(5) == 0, log.read_text(encoding="utf-8")


def _catches_sigterm(pid: int) -> bool:
    """Return True if a process has a handler for SIGTERM (bit 14 of SigCgt)."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("SigCgt:"):
            return bool(int(line.split()[1], 16) >> 14 & 1)
    return False
