# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products in the outbox are kept until the DPM acknowledges them, also after a restart of the process."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import CdffError, CodecError, ConfigurationError, InputError, UnavailableError
from cdff_common.loops import Loops
from services.alarms import Alarms
from services.dfpc_host.outbox import Outbox
from services.dfpc_host.outbox_alarms import set_outbox_alarms
from services.dfpc_host.spool import Spool, SpooledProduct, capacity_bytes

OWNERS = [("mana", "slam"), ("mana", "mapping")]


class Dpm:
    """DPM double: accepts products while in contact, refuses payload ``bad``, fails on payload ``bug``."""

    def __init__(self, in_contact: bool = True) -> None:
        self.in_contact = in_contact
        self.received: list[bytes] = []
        self.timeouts_s: list[float] = []

    def call(self, key: str, parameters: Any, *, payload: bytes, timeout_s: float, **_: Any) -> None:
        if not self.in_contact:
            raise UnavailableError("out of contact")
        if payload == b"bad":
            raise InputError("bad")
        if payload == b"bug":
            raise CdffError("INTERNAL")
        assert (key, parameters["product"]) == ("cdff/@v1/mana/dpm/@rpc/put", "pose")
        self.timeouts_s.append(timeout_s)
        self.received.append(payload)


def product(payload: bytes, dfpc: str = "slam") -> SpooledProduct:
    return SpooledProduct("mana", dfpc, "pose", "pose", payload, "encoding", b"attachment")


def wait_until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.fixture(autouse=True)
def _short_retry_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.dfpc_host.outbox._RETRY_S", 0.02)


@contextmanager
def outbox_of(dpm: Dpm, folder: Path, capacity: int = 1_000_000) -> Iterator[Outbox]:
    outbox = Outbox(dpm, Spool(folder, OWNERS, capacity), Loops().add("outbox"))  # type: ignore[arg-type]
    try:
        yield outbox
    finally:
        outbox.close(drain_s=0.05)


@pytest.mark.req("CDFF-SUP-194")
def test_products_inserted_without_contact_are_delivered_in_order_afterwards(tmp_path: Path) -> None:
    dpm = Dpm(in_contact=False)
    with outbox_of(dpm, tmp_path) as outbox:
        for i in range(20):
            outbox.put(product(b"%d" % i))
        wait_until(lambda: outbox.last_error == "out of contact")
        assert (len(outbox.spool), dpm.received) == (20, [])
        dpm.in_contact = True
        wait_until(lambda: not outbox.spool)
    assert dpm.received == [b"%d" % i for i in range(20)]
    assert (outbox.spool.dropped, outbox.refused, outbox.spool.bytes) == (0, 0, 0)
    assert not list(tmp_path.rglob("*.product"))


@pytest.mark.req("CDFF-SUP-194")
def test_a_new_process_first_delivers_the_products_of_the_previous_one(
    tmp_path: Path,
) -> None:
    spool = Spool(tmp_path, OWNERS, 1_000_000)  # of the previous process, which was killed
    for i, dfpc in enumerate(("slam", "mapping", "slam")):
        spool.add(product(b"before %d" % i, dfpc))
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        outbox.put(product(b"after"))
        wait_until(lambda: len(dpm.received) == 4)
    assert dpm.received == [b"before 0", b"before 1", b"before 2", b"after"]


def test_products_of_other_dfpcs_are_not_touched(tmp_path: Path) -> None:
    Spool(tmp_path, [], 10_000).add(product(b"of another DFPC", "mapping"))
    assert len(Spool(tmp_path, [("mana", "slam")], 10_000)) == 0
    assert len(Spool(tmp_path, OWNERS, 10_000)) == 1


@pytest.mark.req("CDFF-SUP-194")
def test_beyond_the_capacity_the_oldest_are_dropped_and_counted(tmp_path: Path) -> None:
    dpm = Dpm(in_contact=False)
    with outbox_of(dpm, tmp_path, capacity=15_000) as outbox:
        for i in range(10):
            outbox.put(product(b"%d" % i * 4_500))
        assert (len(outbox.spool), outbox.spool.dropped) == (3, 7)
        assert 13_500 < outbox.spool.bytes <= 15_000
        dpm.in_contact = True
        wait_until(lambda: not outbox.spool)
    assert dpm.received[-3:] == [b"7" * 4_500, b"8" * 4_500, b"9" * 4_500]
    assert len(list(tmp_path.rglob("*.product"))) == 0


@pytest.mark.parametrize("writable", [True, False])
def test_a_small_product_counts_as_one_disk_block(tmp_path: Path, writable: bool) -> None:
    folder = tmp_path / "spool"
    if not writable:
        folder.write_text("a file")
    spool = Spool(folder, OWNERS, 3 * 4096)
    for _ in range(5):
        spool.add(product(b"small"))
    assert (len(spool), spool.dropped, spool.bytes) == (3, 2, 3 * 4096)


def test_refused_products_are_counted_and_do_not_block_others(tmp_path: Path) -> None:
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        outbox.put(product(b"bad"))
        outbox.put(product(b"good"))
        wait_until(lambda: dpm.received)
        assert outbox.refused == 1
        assert "the DPM refused slam/pose: bad" in outbox.last_error


def test_a_truncated_file_is_counted_and_does_not_block_other_products(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 10_000)
    for payload in (b"half", b"whole"):
        spool.add(product(payload))
    truncated = spool.first().path
    truncated.write_bytes(truncated.read_bytes()[:9])
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        wait_until(lambda: dpm.received)
        assert outbox.refused == 1
        assert "expected a product" in outbox.last_error
    assert dpm.received == [b"whole"]


@pytest.mark.parametrize("offset", [-1, 30])
def test_a_file_with_a_block_not_written_is_refused_by_its_checksum(tmp_path: Path, offset: int) -> None:
    spool = Spool(tmp_path, OWNERS, 10_000)
    spool.add(product(bytes(range(1, 200))))
    path = spool.first().path
    data = bytearray(path.read_bytes())
    data[offset] = 0  # the length is correct, but one block was not written
    path.write_bytes(data)
    with pytest.raises(CodecError, match="CRC-32"):
        spool.first().read()


def test_an_unreadable_file_is_counted_and_does_not_block_other_products(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = Spool(tmp_path, OWNERS, 10_000)
    for payload in (b"unreadable", b"readable"):
        spool.add(product(payload))
    unreadable, original_read_bytes = spool.first().path, Path.read_bytes

    def read_bytes(path: Path) -> bytes:
        if path == unreadable:
            raise OSError(errno.EIO, "Input/output error", str(path))
        return original_read_bytes(path)

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        wait_until(lambda: dpm.received)
        assert outbox.refused == 1
        assert "Input/output error" in outbox.last_error
    assert dpm.received == [b"readable"]


def test_a_product_that_cannot_be_read_for_lack_of_file_handles_is_delivered_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_count = 0
    original_read_bytes = Path.read_bytes

    def read_bytes(path: Path) -> bytes:
        nonlocal read_count
        read_count += 1
        if read_count == 1:
            raise OSError(errno.EMFILE, "Too many open files")
        return original_read_bytes(path)

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        outbox.put(product(b"a"))
        wait_until(lambda: dpm.received)
        assert outbox.refused == 0


def test_a_product_with_which_the_dpm_fails_is_moved_to_the_end_of_the_queue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.dfpc_host.outbox._FAILURES", 3)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        for payload in (b"bug", b"a", b"b"):
            outbox.put(product(payload))
        wait_until(lambda: len(dpm.received) == 2)
        wait_until(lambda: len(outbox.spool) == 1)
        assert outbox.refused == 0
    assert dpm.received == [b"a", b"b"]
    assert len(Spool(tmp_path, OWNERS, 10_000)) == 1


def test_a_file_that_cannot_be_deleted_does_not_block_other_products(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unlink(path: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "unlink", unlink)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path, capacity=1) as outbox:
        for payload in (b"a", b"b"):
            outbox.put(product(payload))  # "b" drops "a" unless it was delivered before
        wait_until(lambda: not outbox.spool)
    assert dpm.received[-1] == b"b"


def test_foreign_files_are_kept_and_partial_ones_removed(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 1_000_000)
    spool.add(product(b"a"))
    path = spool.first().path
    foreign, partial = (
        path.with_name("copy of it.product"),
        path.with_name("00000000000000000007.product.part"),
    )
    for file in (foreign, partial):
        file.write_bytes(b"half")
    assert len(Spool(tmp_path, OWNERS, 1_000_000)) == 1
    assert foreign.exists()
    assert not partial.exists()


def test_without_a_writable_disk_products_wait_in_memory(tmp_path: Path) -> None:
    folder = tmp_path / "no_folder"
    folder.write_text("a file")
    dpm = Dpm(in_contact=False)
    with outbox_of(dpm, folder, capacity=3 * 4096) as outbox:
        for i in range(10):
            outbox.put(product(b"%d" % i * 900))
        assert (len(outbox.spool), outbox.spool.dropped) == (3, 7)
        dpm.in_contact = True
        wait_until(lambda: not outbox.spool)
    assert dpm.received[-1] == b"9" * 900


def test_a_large_product_has_a_timeout_for_a_slow_link(tmp_path: Path) -> None:
    dpm = Dpm()
    with outbox_of(dpm, tmp_path, capacity=10_000_000) as outbox:
        outbox.put(product(bytes(1_000_000)))
        wait_until(lambda: dpm.received)
    assert dpm.timeouts_s == [45.0]


def test_payloads_of_any_size_survive_a_round_trip(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 1 << 30)
    for size in (0, 1, 70 << 20):
        spool.add(product(bytes(size)))
        assert spool.first().read() == product(bytes(size))
        spool.remove(spool.first())


def test_the_capacity_is_read_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CDFF_OUTBOX_MB", raising=False)
    assert capacity_bytes() == 256_000_000
    monkeypatch.setenv("CDFF_OUTBOX_MB", "2")
    assert capacity_bytes() == 2_000_000
    monkeypatch.setenv("CDFF_OUTBOX_MB", "much")
    with pytest.raises(ConfigurationError, match="CDFF_OUTBOX_MB='much'"):
        capacity_bytes()


@contextmanager
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let every new file of the spool fail, as on a full disk."""

    def replace_file(path: Path, data: bytes, **_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    with monkeypatch.context() as patch:
        patch.setattr("services.dfpc_host.spool.replace_file", replace_file)
        yield


def of_type(name: str, payload: bytes) -> SpooledProduct:
    return SpooledProduct("mana", "slam", name, name, payload, "encoding", b"attachment")


def test_products_that_only_memory_had_are_stated_after_a_kill(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = Spool(tmp_path, OWNERS, 100_000)  # of a process that is killed
    with full_disk(monkeypatch):
        for i in range(3):
            spool.add(product(b"%d" % i))
    assert (spool.in_memory, spool.lost) == (3, 0)
    assert (Spool(tmp_path, OWNERS, 100_000).lost, Spool(tmp_path, OWNERS, 100_000).lost) == (3, 0)


def test_products_in_memory_are_written_once_the_disk_has_space(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = Spool(tmp_path, OWNERS, 100_000)
    with full_disk(monkeypatch):
        spool.add(product(b"a"))
        spool.write_out()
        assert spool.in_memory == 1
    spool.write_out()
    assert spool.in_memory == 0
    following = Spool(tmp_path, OWNERS, 100_000)
    assert (following.lost, following.first().read()) == (0, product(b"a"))


def test_the_first_product_after_a_full_disk_is_written_with_those_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = Spool(tmp_path, OWNERS, 100_000)
    with full_disk(monkeypatch):
        spool.add(product(b"a"))
    spool.add(product(b"b"))
    assert spool.in_memory == 0
    following = Spool(tmp_path, OWNERS, 100_000)
    assert (following.lost, len(following)) == (0, 2)


def test_a_full_spool_drops_the_least_valuable_products_also_of_an_earlier_process(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 3 * 4096)
    for name in ("pose", "disparity", "pointcloud"):
        spool.add(of_type(name, name.encode()))
    spool = Spool(tmp_path, OWNERS, 3 * 4096)
    for name in ("dem", "pose"):
        spool.add(of_type(name, name.encode()))
    assert spool.dropped == 2
    left = []
    while spool:
        left.append(spool.first().read().product)
        spool.remove(spool.first())
    assert left == ["pose", "dem", "pose"]


def test_an_outbox_on_a_full_disk_and_its_losses_raise_alarms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alarms, dpm = Alarms(), Dpm(in_contact=False)
    with outbox_of(dpm, tmp_path) as outbox:
        with full_disk(monkeypatch):
            outbox.put(product(b"a"))
            set_outbox_alarms(alarms, "mana/slam", outbox)
            (alarm,) = alarms.active()
            assert (alarm.kind, alarm.severity) == ("outbox_in_memory", "critical")
        wait_until(lambda: not outbox.spool.in_memory)
        set_outbox_alarms(alarms, "mana/slam", outbox)
        assert alarms.active() == []
        outbox.spool.lost = 2
        set_outbox_alarms(alarms, "mana/slam", outbox)
        assert "2 products were only in memory" in alarms.active()[0].what


def test_products_ahead_of_the_clock_of_the_dpm_wait_and_do_not_block_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.dfpc_host.outbox._FAILURES", 2)

    class LateDpm(Dpm):
        is_late = True

        def call(self, key: str, parameters: Any, *, payload: bytes, timeout_s: float, **_: Any) -> None:
            if self.is_late and payload != b"b":
                raise UnavailableError("capture ends 3600 s after the mission clock's now")
            super().call(key, parameters, payload=payload, timeout_s=timeout_s)

    dpm = LateDpm()
    with outbox_of(dpm, tmp_path) as outbox:
        for payload in (b"a", b"b"):
            outbox.put(product(payload))
        wait_until(lambda: dpm.received == [b"b"])
        assert (outbox.refused, len(outbox.spool)) == (0, 1)
        assert "3600 s" in outbox.last_error
        dpm.is_late = False
        wait_until(lambda: dpm.received == [b"b", b"a"])
