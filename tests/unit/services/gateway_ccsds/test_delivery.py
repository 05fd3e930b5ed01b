# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transfers to an independent receiver, the destination handler of the library, over a link with losses."""

from __future__ import annotations

import hashlib
import json
import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from cfdppy.filestore import NativeFilestore
from cfdppy.handler.dest import DestHandler
from cfdppy.mib import IndicationConfig, LocalEntityConfig, RemoteEntityConfig, RemoteEntityConfigTable
from spacepackets.cfdp.defs import ChecksumType, Direction, TransmissionMode
from spacepackets.cfdp.pdu.helper import PduFactory
from spacepackets.util import ByteFieldU16

from cdff_common.loops import Loops
from cdff_dev.ports import free_port
from services.gateway_ccsds.cfdp_entity import CheckTimers, Faults, User
from services.gateway_ccsds.datagrams import DatagramPort
from services.gateway_ccsds.delivery import Delivery
from services.gateway_ccsds.settings import CfdpSettings
from services.gateway_ccsds.spool import Spool


class Ground:
    """A receiver that drops a fraction of the datagrams, and counts the file data in the others."""

    def __init__(self, folder: Path, listen: int, peer: int, loss: float) -> None:
        self.folder, self._loss, self._random = folder, loss, random.Random(7)
        folder.mkdir()
        self.ports = (peer, listen)
        self.data_bytes, self.names = 0, []
        self._handlers: dict[int, Any] = {}
        self._port = DatagramPort(("127.0.0.1", listen), ("127.0.0.1", peer))
        self._port.start(self._receive)

    def close(self) -> None:
        self._port.close()

    def _receive(self, data: bytes) -> None:
        pdu: Any = PduFactory.from_raw(data)
        if pdu.direction != Direction.TOWARDS_RECEIVER or self._random.random() < self._loss:
            return
        self.data_bytes += len(getattr(pdu, "file_data", b""))
        number = pdu.transaction_seq_num.value
        handler = self._handlers.get(number)
        if handler is None:
            handler = self._handlers[number] = self._handler()
        for packet in (pdu, None):
            handler.state_machine(packet)
            while (answer := handler.get_next_packet()) is not None:
                if self._random.random() >= self._loss:
                    self._port.send(bytes(answer.pdu.pack()))

    def _handler(self) -> Any:
        remote = RemoteEntityConfig(
            ByteFieldU16(21), 800, 900, False, False, TransmissionMode.ACKNOWLEDGED, ChecksumType.MODULAR
        )
        local = LocalEntityConfig(ByteFieldU16(25), IndicationConfig(), Faults())
        table = RemoteEntityConfigTable([remote])
        return DestHandler(local, User(Folder(self.folder)), table, CheckTimers())


class Folder(NativeFilestore):
    """Files of a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __getattribute__(self, name: str) -> Any:
        value = super().__getattribute__(name)
        if name.startswith("_") or name in ("read_from_opened_file", "verify_checksum"):
            return value
        folder = super().__getattribute__("_folder")

        def call(*arguments: Any, **named: Any) -> Any:
            return value(*(folder / a if isinstance(a, Path) else a for a in arguments), **named)

        return call


Link = Callable[..., tuple[Delivery, Spool, Ground]]


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Link]:
    opened: list[Any] = []

    def start(loss: float = 0.0, part_bytes: int = 50_000, ground: Ground | None = None) -> Any:
        up, down = (free_port(), free_port()) if ground is None else ground.ports
        settings = CfdpSettings(
            entity=21, remote=25, listen=f"127.0.0.1:{up}", peer=f"127.0.0.1:{down}", rate_bit_s=8e6
        )
        if ground is None:
            ground = Ground(tmp_path / "ground", down, up, loss)
            opened.append(ground)
        spool = Spool(tmp_path / "spool", part_bytes)
        port = DatagramPort(("127.0.0.1", up), ("127.0.0.1", down))
        delivery = Delivery(settings, spool, port, tmp_path / "n", lambda *_: None, Loops().add("cfdp"))
        opened.append(delivery)
        delivery.start()
        return delivery, spool, ground

    yield start
    for item in reversed(opened):
        item.close()


def wait_until(condition: Callable[[], object], timeout_s: float = 8.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def product(size: int) -> bytes:
    return random.Random(size).randbytes(size)


def assert_received(ground: Ground, payload: bytes) -> None:
    sidecar = json.loads((ground.folder / "mana-dem-1-a.sidecar.json").read_text())
    files = [(ground.folder / file["name"]).read_bytes() for file in sidecar["files"]]
    assert b"".join(files) == payload
    assert hashlib.sha256(payload).hexdigest() == sidecar["sha256"]
    assert [len(file) for file in files] == [file["bytes"] for file in sidecar["files"]]


def test_a_product_arrives_in_files_of_the_largest_size_with_its_sidecar(link: Link) -> None:
    delivery, spool, ground = link()
    payload = product(120_000)
    assert spool.add(1, 1, "mana-dem-1-a", "tif", payload, {"id": "a"})
    delivery.in_contact = True
    wait_until(lambda: spool.size() == (0, 0))
    assert_received(ground, payload)
    assert delivery.counters["delivered"] == 4
    assert ground.data_bytes == delivery.counters["delivered_bytes"]


def test_a_product_arrives_over_a_link_that_loses_packets_both_ways(link: Link) -> None:
    delivery, spool, ground = link(loss=0.05)
    payload = product(60_000)
    spool.add(1, 1, "mana-dem-1-a", "tif", payload, {"id": "a"})
    delivery.in_contact = True
    wait_until(lambda: spool.size() == (0, 0), 60.0)
    assert_received(ground, payload)


def test_transactions_continue_after_a_time_without_contact(link: Link) -> None:
    delivery, spool, ground = link(part_bytes=1_000_000)
    payload = product(400_000)
    spool.add(1, 1, "mana-dem-1-a", "tif", payload, {"id": "a"})
    delivery.in_contact = True
    wait_until(lambda: ground.data_bytes > 100_000)
    delivery.in_contact = False
    time.sleep(0.3)
    received = ground.data_bytes
    time.sleep(0.5)
    assert ground.data_bytes == received < 400_000
    delivery.in_contact = True
    wait_until(lambda: spool.size() == (0, 0))
    assert_received(ground, payload)
    assert delivery.counters["repeated"] == 0
    assert ground.data_bytes < 1.1 * 400_000


def test_a_restart_repeats_one_file_with_a_new_transaction_number(link: Link) -> None:
    delivery, spool, ground = link()
    payload = product(400_000)
    spool.add(1, 1, "mana-dem-1-a", "tif", payload, {"id": "a"})
    delivery.in_contact = True
    wait_until(lambda: delivery.counters["delivered"] >= 3)
    delivery.close()
    waiting = len(spool.files())
    assert 1 <= waiting <= 6
    again, spool, _ = link(ground=ground)
    again.in_contact = True
    wait_until(lambda: spool.size() == (0, 0))
    assert_received(ground, payload)
    assert again.counters["delivered"] == waiting


def test_an_unfinished_folder_of_a_killed_process_is_removed_and_a_product_is_added_once(
    tmp_path: Path,
) -> None:
    (tmp_path / "1-000000000001-x.part").mkdir()
    spool = Spool(tmp_path, 1000)
    assert spool.size() == (0, 0)
    assert spool.add(2, 1, "x", "tif", b"1", {})
    assert not spool.add(3, 0, "x", "tif", b"1", {})
    assert spool.add(4, 0, "y", "tif", b"1", {})
    assert [path.name for path in spool.files()] == ["y.tif", "y.sidecar.json", "x.tif", "x.sidecar.json"]
    assert not spool.is_ready(spool.files()[1])
