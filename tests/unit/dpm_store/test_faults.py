# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Kills, failing calls, full disks and flipped bits."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import StorageError
from dpm_store import Insertion, Query, Rule, Store, open_store
from dpm_store.blobs import CHUNK_BYTES, BlobFiles, digest
from dpm_store.packs import pack_of, places_of
from dpm_store.payloads import PACKED_BYTES
from tests.kill_dpm import campaign

from .conftest import header, put

ROOT = Path(__file__).resolve().parents[3]
COMPILER = shutil.which("cc") or shutil.which("gcc")
MB = 1 << 20


@pytest.mark.req("CDFF-SUP-032")
@pytest.mark.parametrize("runs", [2, pytest.param(15, marks=pytest.mark.slow)])
def test_what_was_acknowledged_before_a_kill_is_there_and_nothing_is_half_written(tmp_path: Path, runs: int) -> None:
    summary = campaign(tmp_path, runs, seed=runs)
    assert summary["findings"] == []
    assert summary["verify"]["problems"] == []
    assert summary["told"]["put done"] > 0


@pytest.mark.req("CDFF-SUP-172")
@pytest.mark.skipif(COMPILER is None, reason="needs a C compiler to make the calls that fail")
@pytest.mark.parametrize("stride", [97, pytest.param(13, marks=pytest.mark.slow)])
def test_wherever_a_call_fails_the_error_is_typed_and_the_store_is_whole(
    empty: Path, tmp_path: Path, stride: int
) -> None:
    library, work = tmp_path / "faults.so", tmp_path / "work"
    work.mkdir()
    assert COMPILER is not None
    command = [COMPILER, "-shared", "-fPIC", "-o", str(library), str(ROOT / "tests" / "faults.c"), "-ldl"]
    subprocess.run(command, check=True)
    done = subprocess.run(
        [sys.executable, "-m", "tests.fault_load", str(empty), str(work), str(stride)],
        cwd=ROOT, env=os.environ | {"LD_PRELOAD": str(library)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    summary = json.loads(done.stdout)
    assert summary["problems"] == []
    assert len(summary["injected"]) == 20
    assert all(count > 0 for count in summary["injected"].values()), summary["injected"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 32 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", str(disk)], capture_output=True, text=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"a small file system cannot be mounted here: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def fill(path: Path) -> None:
    """Write until the disk is full to the last byte."""
    with suppress(OSError), path.open("wb", buffering=0) as file:
        for size in (MB, 4096, 1):
            with suppress(OSError):
                while file.write(bytes(size)):
                    pass


def fill_store(store: Store, size: int) -> None:
    """Insert until it is refused."""
    for seq in range(10_000):
        put(store, header(seq), seq.to_bytes(2, "big") * (size // 2))


@pytest.mark.req("CDFF-SUP-170")
@pytest.mark.parametrize("size", [PACKED_BYTES, 4 * PACKED_BYTES])
def test_on_a_full_disk_nothing_is_added_and_everything_can_be_deleted(
    small_disk: Path, clock: ManualClock, size: int
) -> None:
    url = f"sqlite:///{small_disk}/data"
    with open_store(url, clock, low_water_bytes=8 * MB, reserve_bytes=4 * MB) as store:
        with pytest.raises(StorageError, match=r"kept for deleting.*cdff dpm retention"):
            fill_store(store, size)
        count = store.statistics().count
        assert count > 20
        fill(small_disk / "ballast")  # somebody else
        assert os.statvfs(small_disk).f_bavail == 0
        with pytest.raises(StorageError):
            put(store, header(20_000))
        assert store.delete(header(0).id)
        assert store.retention.apply([Rule("dem", max_count=10)]).going == count - 11
        assert store.collect() >= (count - 11) * size
        assert [r.header.seq for r in store.search(Query()).items] == list(range(count - 1, count - 11, -1))
    with open_store(url, clock, low_water_bytes=8 * MB, reserve_bytes=4 * MB) as store:  # the disk is still full
        assert store.verify() == ()
        assert store.delete(header(count - 1).id)
        (small_disk / "ballast").unlink()
        assert put(store, header(30_000), b"z" * size) is Insertion.INSERTED
        assert store.delete(header(count - 2).id)
    assert (small_disk / "data" / "store.reserve").stat().st_size == 4 * MB


def test_a_reserve_is_not_taken_unasked(tmp_path: Path) -> None:
    open_store(f"sqlite:///{tmp_path}").close()
    assert not (tmp_path / "store.reserve").exists()


@pytest.mark.req("CDFF-SUP-171")
@pytest.mark.parametrize("size", [10, PACKED_BYTES, PACKED_BYTES + 1, 3 * CHUNK_BYTES])
@pytest.mark.parametrize("where", [0.0, 0.5, 1.0])
def test_a_flipped_bit_is_found_and_never_served(store: Store, size: int, where: float) -> None:
    payload = bytes(range(256)) * (size // 256 + 1)
    put(store, header(1), payload[:size])
    flip(store, digest(payload[:size]), int(where * (size - 1)))
    with pytest.raises(StorageError, match="not what was written"):
        store.payload(header(1).id)
    (problem,) = store.verify()
    assert digest(payload[:size]) in problem.where
    assert put(store, header(2), payload[:size]) is Insertion.INSERTED  # the same content again mends it
    assert store.payload(header(1).id) == payload[:size]
    assert store.verify() == ()


def flip(store: Store, sha256: str, at: int) -> None:
    """Change one bit of a payload, where it lies."""
    path = store.directory / "blobs" / sha256[:2] / sha256[2:]
    if not path.exists():
        with store._database.read() as connection:
            place = connection.exec_driver_sql("SELECT place FROM blobs WHERE sha256 = ?", (sha256,)).scalar_one()
        path, at = store._payloads.packs.path(pack_of(place)), place - places_of(pack_of(place))[0] + at
    with path.open("r+b") as file:
        file.seek(at)
        changed = bytes([file.read(1)[0] ^ 4])
        file.seek(at)
        file.write(changed)


def test_a_header_that_was_changed_is_found(store: Store) -> None:
    put(store, header(1))
    put(store, header(2))
    with store._database.write() as connection:
        connection.exec_driver_sql("UPDATE products SET header = ? WHERE ordinal = 1", (b"\xc1",))
        connection.exec_driver_sql("UPDATE products SET t1_ns = t1_ns + 1 WHERE ordinal = 2")
    assert [(p.where, p.what[:10]) for p in store.verify()] == [
        (f"product {header(1).id}", "header not"), (f"product {header(2).id}", "its row an"),
    ]  # fmt: skip


def test_a_payload_whose_folder_could_not_be_synced_is_synced_the_next_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files, payload = BlobFiles(tmp_path), b"x" * 100
    folder = files.path(digest(payload)).parent
    folder.mkdir()
    synced: list[Path] = []
    real, broken = os.fsync, True

    def fsync(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        if broken and synced[-1] == folder:
            raise OSError(5, "Input/output error")
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(StorageError, match="the disk failed"):
        files.write(digest(payload), payload)
    broken = False
    synced.clear()
    files.write(digest(payload), payload)
    assert synced == [files.path(digest(payload)), folder]
