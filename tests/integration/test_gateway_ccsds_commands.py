# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Commands of a ground segment, sent as packets to the gateway of a DPM with an orchestrator."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from spacepackets.ecss.req_id import RequestId
from spacepackets.ecss.tc import PusTc
from spacepackets.ecss.tm import PusTm

from cdff_common.bus import Bus, keys
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance
from cdff_dev.ports import free_port
from services.gateway_ccsds.authentication import Command, CommandKey, Function
from tests.integration.conftest import process_starter, wait_until
from tests.support.orchestrated_products import NOW_NS, patch, put

pytestmark = [pytest.mark.integration, pytest.mark.slow]

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")
_SETTINGS = """
robot: mana
cfdp: {{entity: 21, remote: 25, listen: "127.0.0.1:{cfdp_up}", peer: "127.0.0.1:{cfdp_down}"}}
packets: {{apid: 77, listen: "127.0.0.1:{tc}", peer: "127.0.0.1:{tm}", housekeeping_s: 1}}
products: [{{type: dem}}]
command_key: command.key
"""


class Ground:
    """A ground segment that sends telecommands and receives telemetry, without a mission control system."""

    def __init__(self, folder: Path, bus: Bus, tm: int, tc: int) -> None:
        self._bus, self._folder, self._peer = bus, folder, ("127.0.0.1", tc)
        self._key = CommandKey.read(folder / "command.key")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", tm))
        self._socket.setblocking(False)
        self._counter = 0
        self._reports: dict[bytes, dict[int, str]] = {}
        self._events: list[list[str]] = []

    def close(self) -> None:
        self._socket.close()

    def send(self, function: Function, **arguments: Any) -> bytes:
        """Send a command; return the id of its verification reports."""
        self._counter += 1
        body = self._key.seal("mana", Command(function, self._counter, arguments))
        tc = PusTc(service=8, message_subtype=1, apid=77, app_data=body, seq_count=self._counter)
        self._socket.sendto(bytes(tc.pack()), self._peer)
        return bytes(RequestId.from_pus_tc(tc).pack())

    def result(self, request: bytes) -> str | None:
        """Return the reason of the failed completion; empty for a success, None before the completion."""
        self._receive()
        stages = self._reports.get(request, {})
        return next((stages[subtype] for subtype in (7, 8) if subtype in stages), None)

    def completion(self, function: Function, **arguments: Any) -> str:
        """Send a command and return the reason of its failure; empty for a success."""
        request = self.send(function, **arguments)
        wait_until(lambda: self.result(request) is not None, 60, f"the completion of {function.name}")
        return str(self.result(request))

    def events(self, kind: str) -> list[str]:
        """Return the texts of the received events of a kind."""
        self._receive()
        return [text for name, _, text in self._events if name == kind]

    def waiting_files(self) -> list[str]:
        """Return the names of the files in the spool of the gateway."""
        spool = self._folder / "data" / "gateway_ccsds" / "mana" / "outgoing"
        return [path.name for path in spool.glob("[0-9]-*/*")]

    def status(self) -> dict[str, Any]:
        """Return the status of the gateway."""
        return dict(self._bus.call(keys.gateway_status("mana", "gateway_ccsds")).body())

    def _receive(self) -> None:
        while True:
            try:
                packet = PusTm.unpack(self._socket.recv(65535), timestamp_len=8)
            except BlockingIOError:
                return
            data = packet.source_data
            if packet.service == 1:
                text = data[7:].decode() if packet.message_subtype % 2 == 0 else ""
                self._reports.setdefault(bytes(data[:4]), {})[packet.message_subtype] = text
            elif packet.service == 5:
                self._events.append(_texts(data))


def _texts(data: bytes) -> list[str]:
    """Return the texts of an event report."""
    texts = []
    while data:
        texts.append(data[1 : 1 + data[0]].decode())
        data = data[1 + data[0] :]
    return texts


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ground]:
    """A ground segment of a running system with a map and a pose."""
    folder, endpoint = tmp_path_factory.mktemp("ccsds"), f"tcp/127.0.0.1:{free_port()}"
    ports = {name: free_port() for name in ("tm", "tc", "cfdp_down", "cfdp_up")}
    (folder / "ground.yaml").write_text(_SETTINGS.format(**ports))
    CommandKey.write(folder / "command.key")
    with process_starter(endpoint, folder) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        spawn("services.orchestrator", "--profile", PROFILE)
        with Bus.open(endpoint, name="test", wait_s=20) as bus:
            wanted = {keys.alive("mana", s) for s in ("dpm", "orchestrator")}
            wait_until(lambda: wanted <= bus.alive(keys.alive("mana", "*")), 90, "start-up")
            put(bus, "dem", patch(0.0, 1.0, age_s=10.0))
            base = TransformWithCovariance.from_transform(
                UncertainTransform.identity(), parent="site", child="mana/base", stamp_ns=NOW_NS
            )
            put(bus, "pose", base, child="mana/base")
            spawn("services.gateway_ccsds", "--settings", str(folder / "ground.yaml"))
            gateway = keys.alive("mana", "gateway_ccsds")
            wait_until(lambda: bus.alive(gateway), 60, "the gateway")
            ground = Ground(folder, bus, ports["tm"], ports["tc"])
            yield ground
            ground.close()


def test_a_requested_map_waits_for_its_transfer_in_the_requested_format(ground: Ground) -> None:
    region = "bbox:0,0,2,2"
    result = ground.completion(Function.REQUEST, type="dem", region=region, format="tif", deadline_ms=40000)
    assert result == ""
    map_name, sidecar_name = sorted(ground.waiting_files(), key=len)
    assert re.fullmatch(r"mana-dem-\d+-[0-9a-f-]{36}\.tif", map_name)
    assert sidecar_name == map_name.replace(".tif", ".sidecar.json")
    product = map_name.removesuffix(".tif")[-36:]
    wait_until(lambda: f"product {product}" in ground.events("command_executed"), 10, "the event")


def test_a_request_in_progress_is_cancelled_by_its_job_from_the_event(ground: Ground) -> None:
    earlier = len(ground.events("command_progress"))
    request = ground.send(Function.REQUEST, type="pose", max_age_s=0.0001, deadline_ms=120000)
    wait_until(lambda: len(ground.events("command_progress")) > earlier, 30, "the job of the request")
    job = ground.events("command_progress")[-1].removeprefix("job ").partition(":")[0]
    assert ground.completion(Function.CANCEL, job=job) == ""
    wait_until(lambda: ground.result(request) is not None, 30, "the end of the request")
    assert "cancelled" in str(ground.result(request))


def test_wrong_arguments_fail_with_the_type_of_the_error_and_the_gateway_continues(ground: Ground) -> None:
    request, cancel, send = Function.REQUEST, Function.CANCEL, Function.SEND
    wrong = [
        (request, {}, "InputError: parameter 'type' is missing"),
        (request, {"type": "dem", "deadline_ms": "abc"}, "InputError: deadline_ms='abc': expected a number"),
        (request, {"type": "nonsense"}, "InputError: "),
        (request, {"type": "pose", "frame": "nosuch"}, "ProductNotFoundError: "),
        (cancel, {}, "InputError: parameter 'job' is missing"),
        (cancel, {"job": "unknown"}, "ProductNotFoundError: "),
        (send, {"id": 5}, "InputError: id=5"),
        (send, {"id": "7b0b7d3c-0000-5000-8000-000000000000"}, "ProductNotFoundError: "),
    ]
    for function, arguments, reason in wrong:
        assert ground.completion(function, **arguments).startswith(reason)
    wait_until(lambda: ground.status()["commands"].get("failed", 0) >= len(wrong), 10, "the counter")
    assert ground.completion(request, type="dem", region="bbox:0,0,2,2") == ""
