# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products on their way into the DPM: kept until acknowledged, also over the end of the process."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import CdffError, CodecError, ConfigurationError, InputError, UnavailableError
from services.dfpc_host.outbox import Outbox
from services.dfpc_host.spool import Parcel, Spool, capacity_bytes, opened

OWNERS = [("mana", "slam"), ("mana", "mapping")]


class Dpm:
    """Takes what it is handed while it is in contact; refuses payload ``bad``, breaks on payload ``bug``."""

    def __init__(self, in_contact: bool = True) -> None:
        self.in_contact = in_contact
        self.taken: list[bytes] = []
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
        self.taken.append(payload)


def parcel(payload: bytes, dfpc: str = "slam") -> Parcel:
    return Parcel("mana", dfpc, "pose", "pose", payload, "encoding", b"attachment")


def until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.dfpc_host.outbox._RETRY_S", 0.02)


@contextmanager
def outbox_of(dpm: Dpm, folder: Path, capacity: int = 1_000_000) -> Iterator[Outbox]:
    outbox = Outbox(dpm, Spool(folder, OWNERS, capacity))  # type: ignore[arg-type]
    try:
        yield outbox
    finally:
        outbox.close(drain_s=0.05)


@pytest.mark.req("CDFF-SUP-194")
def test_what_is_made_out_of_contact_arrives_in_order_once_contact_is_back(tmp_path: Path) -> None:
    dpm = Dpm(in_contact=False)
    with outbox_of(dpm, tmp_path) as outbox:
        for i in range(20):
            outbox.put(parcel(b"%d" % i))
        until(lambda: outbox.last_error == "out of contact")
        assert (outbox.pending, dpm.taken) == (20, [])
        dpm.in_contact = True
        until(lambda: not outbox.pending)
    assert dpm.taken == [b"%d" % i for i in range(20)]
    assert (outbox.dropped, outbox.refused, outbox.pending_bytes) == (0, 0, 0)
    assert not list(tmp_path.rglob("*.parcel"))


@pytest.mark.req("CDFF-SUP-194")
def test_the_next_process_delivers_what_the_last_one_could_not_before_what_it_makes_itself(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 1_000_000)  # of a process that is killed here
    for i, dfpc in enumerate(("slam", "mapping", "slam")):
        spool.add(parcel(b"before %d" % i, dfpc))
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        outbox.put(parcel(b"after"))
        until(lambda: len(dpm.taken) == 4)
    assert dpm.taken == [b"before 0", b"before 1", b"before 2", b"after"]


def test_parcels_of_other_dfpcs_are_left_to_their_own_processes(tmp_path: Path) -> None:
    Spool(tmp_path, [], 10_000).add(parcel(b"other's", "mapping"))
    assert len(Spool(tmp_path, [("mana", "slam")], 10_000)) == 0
    assert len(Spool(tmp_path, OWNERS, 10_000)) == 1


@pytest.mark.req("CDFF-SUP-194")
def test_beyond_its_capacity_the_oldest_go_and_are_counted(tmp_path: Path) -> None:
    dpm = Dpm(in_contact=False)
    with outbox_of(dpm, tmp_path, capacity=15_000) as outbox:
        for i in range(10):
            outbox.put(parcel(b"%d" % i * 4_500))
        assert (outbox.pending, outbox.dropped) == (3, 7)
        assert 13_500 < outbox.pending_bytes <= 15_000
        dpm.in_contact = True
        until(lambda: not outbox.pending)
    assert dpm.taken[-3:] == [b"7" * 4_500, b"8" * 4_500, b"9" * 4_500]
    assert len(list(tmp_path.rglob("*.parcel"))) == 0


@pytest.mark.parametrize("writable", [True, False])
def test_a_small_parcel_counts_as_a_block_of_the_disk(tmp_path: Path, writable: bool) -> None:
    folder = tmp_path / "spool"
    if not writable:
        folder.write_text("a file")
    spool = Spool(folder, OWNERS, 3 * 4096)
    for _ in range(5):
        spool.add(parcel(b"small"))
    assert (len(spool), spool.dropped, spool.bytes) == (3, 2, 3 * 4096)


def test_what_the_dpm_refuses_is_counted_and_does_not_hold_up_the_rest(tmp_path: Path) -> None:
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        outbox.put(parcel(b"bad"))
        outbox.put(parcel(b"good"))
        until(lambda: dpm.taken)
        assert (outbox.refused, outbox.pending) == (1, 0) or outbox.refused == 1
        assert "the DPM refused slam/pose: bad" in outbox.last_error


def test_a_file_that_was_half_written_is_counted_and_does_not_hold_up_the_rest(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 10_000)
    for payload in (b"half", b"whole"):
        spool.add(parcel(payload))
    broken = spool.first().path
    broken.write_bytes(broken.read_bytes()[:9])
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        until(lambda: dpm.taken)
        assert outbox.refused == 1
        assert "expected a parcel" in outbox.last_error
    assert dpm.taken == [b"whole"]


@pytest.mark.parametrize("at", [-1, 30])
def test_a_file_of_which_a_part_was_never_written_is_no_product(tmp_path: Path, at: int) -> None:
    spool = Spool(tmp_path, OWNERS, 10_000)
    spool.add(parcel(bytes(range(1, 200))))
    path = spool.first().path
    data = bytearray(path.read_bytes())
    data[at] = 0  # as long as it was: the kernel had not written that block
    path.write_bytes(data)
    with pytest.raises(CodecError, match="CRC-32"):
        opened(spool.first())


def test_a_file_that_cannot_be_read_is_counted_and_does_not_hold_up_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = Spool(tmp_path, OWNERS, 10_000)
    for payload in (b"unreadable", b"readable"):
        spool.add(parcel(payload))
    broken, read = spool.first().path, Path.read_bytes

    def read_bytes(path: Path) -> bytes:
        if path == broken:
            raise OSError(errno.EIO, "Input/output error", str(path))
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        until(lambda: dpm.taken)
        assert outbox.refused == 1
        assert "Input/output error" in outbox.last_error
    assert dpm.taken == [b"readable"]


def test_a_process_short_of_file_handles_keeps_what_it_cannot_open_for_the_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries = 0
    read = Path.read_bytes

    def read_bytes(path: Path) -> bytes:
        nonlocal tries
        tries += 1
        if tries == 1:
            raise OSError(errno.EMFILE, "Too many open files")
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        outbox.put(parcel(b"a"))
        until(lambda: dpm.taken)
        assert outbox.refused == 0


def test_a_parcel_on_which_the_dpm_breaks_goes_behind_the_others_and_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.dfpc_host.outbox._FAILURES", 3)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path) as outbox:
        for payload in (b"bug", b"a", b"b"):
            outbox.put(parcel(payload))
        until(lambda: len(dpm.taken) == 2)
        until(lambda: outbox.pending == 1)
        assert outbox.refused == 0
    assert dpm.taken == [b"a", b"b"]
    assert len(Spool(tmp_path, OWNERS, 10_000)) == 1


def test_a_file_that_cannot_be_removed_does_not_hold_up_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unlink(path: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "unlink", unlink)
    dpm = Dpm()
    with outbox_of(dpm, tmp_path, capacity=1) as outbox:
        for payload in (b"a", b"b"):
            outbox.put(parcel(payload))  # the second one may drop the first one
        until(lambda: not outbox.pending)
    assert dpm.taken[-1] == b"b"


def test_files_that_are_no_parcels_are_left_and_those_half_written_removed(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 1_000_000)
    spool.add(parcel(b"a"))
    path = spool.first().path
    foreign, part = path.with_name("copy of it.parcel"), path.with_name("00000000000000000007.part")
    for other in (foreign, part):
        other.write_bytes(b"half")
    assert len(Spool(tmp_path, OWNERS, 1_000_000)) == 1
    assert foreign.exists()
    assert not part.exists()


def test_where_no_file_can_be_written_parcels_wait_in_memory(tmp_path: Path) -> None:
    folder = tmp_path / "no_folder"
    folder.write_text("a file")
    dpm = Dpm(in_contact=False)
    with outbox_of(dpm, folder, capacity=3 * 4096) as outbox:
        for i in range(10):
            outbox.put(parcel(b"%d" % i * 900))
        assert (outbox.pending, outbox.dropped) == (3, 7)
        dpm.in_contact = True
        until(lambda: not outbox.pending)
    assert dpm.taken[-1] == b"9" * 900


def test_a_large_product_is_given_time_for_a_slow_link(tmp_path: Path) -> None:
    dpm = Dpm()
    with outbox_of(dpm, tmp_path, capacity=10_000_000) as outbox:
        outbox.put(parcel(bytes(1_000_000)))
        until(lambda: dpm.taken)
    assert dpm.timeouts_s == [45.0]


def test_payloads_of_any_size_come_back_as_they_were(tmp_path: Path) -> None:
    spool = Spool(tmp_path, OWNERS, 1 << 30)
    for size in (0, 1, 70 << 20):
        spool.add(parcel(bytes(size)))
        assert opened(spool.first()) == parcel(bytes(size))
        spool.done(spool.first())


def test_the_capacity_is_a_setting_of_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CDFF_OUTBOX_MB", raising=False)
    assert capacity_bytes() == 256_000_000
    monkeypatch.setenv("CDFF_OUTBOX_MB", "2")
    assert capacity_bytes() == 2_000_000
    monkeypatch.setenv("CDFF_OUTBOX_MB", "much")
    with pytest.raises(ConfigurationError, match="CDFF_OUTBOX_MB='much'"):
        capacity_bytes()
