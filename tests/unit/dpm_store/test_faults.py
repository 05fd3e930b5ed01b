# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The store after kills, failing system calls, full disks and flipped bits."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import select, update

from cdff_common.clock import ManualClock
from cdff_common.errors import StorageError
from dpm_store import Insertion, Query, Rule, Store, open_store
from dpm_store.engine import schema
from dpm_store.payloads.blobs import CHUNK_BYTES, BlobFiles, chunk_sums, digest
from dpm_store.payloads.objects import ObjectPacks
from dpm_store.payloads.packs import location_range, pack_of
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.kill_dpm import campaign
from tests.support import postgresql
from tests.support.postgresql import WITH_FILES
from tests.support.store_products import header, put

ENGINES = WITH_FILES

ROOT = Path(__file__).resolve().parents[3]
COMPILER = shutil.which("cc") or shutil.which("gcc")
MB = 1 << 20


@pytest.mark.req("CDFF-SUP-032")
@pytest.mark.parametrize(
    "runs", [2, pytest.param(8, marks=pytest.mark.slow), pytest.param(50, marks=pytest.mark.soak)]
)
def test_acknowledged_changes_survive_a_kill_and_no_change_is_partly_written(
    tmp_path: Path, runs: int
) -> None:
    summary = campaign(tmp_path, runs, seed=runs)
    assert summary["findings"] == []
    assert summary["verify"]["problems"] == []
    assert summary["reported"]["put done"] > 0


@pytest.mark.req("CDFF-SUP-172")
@pytest.mark.skipif(COMPILER is None, reason="needs a C compiler to build the library of failing calls")
@pytest.mark.parametrize(
    "stride", [pytest.param(193, marks=pytest.mark.slow), pytest.param(13, marks=pytest.mark.soak)]
)
def test_every_failing_call_gives_a_typed_error_and_an_intact_store(
    empty: Path, tmp_path: Path, stride: int
) -> None:
    library, work = tmp_path / "faults.so", tmp_path / "work"
    work.mkdir()
    assert COMPILER is not None
    command = [COMPILER, "-shared", "-fPIC", "-o", str(library), str(ROOT / "tests" / "faults.c"), "-ldl"]
    subprocess.run(command, check=True)
    result = subprocess.run(
        [sys.executable, "-m", "tests.fault_load", str(empty), str(work), str(stride)],
        cwd=ROOT,
        env=os.environ | {"LD_PRELOAD": str(library)},
        capture_output=True,
        text=True,
        check=True,
    )
    summary = json.loads(result.stdout)
    assert summary["problems"] == []
    assert len(summary["injected"]) == 20
    assert all(count > 0 for count in summary["injected"].values()), summary["injected"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 32 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", str(disk)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip(f"a small file system cannot be mounted here: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def fill(path: Path) -> None:
    """Write until the disk is full."""
    with suppress(OSError), path.open("wb", buffering=0) as file:
        for size in (MB, 4096, 1):
            with suppress(OSError):
                while file.write(bytes(size)):
                    pass


def fill_store(store: Store, size: int) -> None:
    """Insert until an insertion is refused."""
    for seq in range(10_000):
        put(store, header(seq), np.random.default_rng(seq).bytes(size))


@pytest.mark.req("CDFF-SUP-170")
@pytest.mark.parametrize("size", [PACKED_BYTES, pytest.param(4 * PACKED_BYTES, marks=pytest.mark.slow)])
def test_on_a_full_disk_nothing_is_added_and_everything_can_be_deleted(
    small_disk: Path, clock: ManualClock, size: int
) -> None:
    url = f"sqlite:///{small_disk}/data"
    with open_store(url, clock, low_water_bytes=8 * MB, reserve_bytes=4 * MB) as store:
        with pytest.raises(StorageError, match=r"kept for deleting.*cdff dpm retention"):
            fill_store(store, size)
        count = store.statistics().count
        assert count > 20
        fill(small_disk / "ballast")  # another program
        assert os.statvfs(small_disk).f_bavail == 0
        with pytest.raises(StorageError):
            put(store, header(20_000))
        assert store.delete(header(0).id)
        assert store.retention.apply([Rule(product="dem", max_count=10)]).to_delete == count - 11
        assert store.collect() >= (count - 11) * size
        assert [r.header.seq for r in store.search(Query()).items] == list(range(count - 1, count - 11, -1))
    with open_store(
        url, clock, low_water_bytes=8 * MB, reserve_bytes=4 * MB
    ) as store:  # the disk is still full
        assert store.verify() == ()
        assert store.delete(header(count - 1).id)
        (small_disk / "ballast").unlink()
        assert put(store, header(30_000), b"z" * size) is Insertion.INSERTED
        assert store.delete(header(count - 2).id)
    assert (small_disk / "data" / "store.reserve").stat().st_size == 4 * MB


def test_there_is_no_reserve_by_default(tmp_path: Path) -> None:
    open_store(f"sqlite:///{tmp_path}").close()
    assert not (tmp_path / "store.reserve").exists()


@pytest.mark.req("CDFF-SUP-171")
@pytest.mark.parametrize("engine", postgresql.ENGINES)
@pytest.mark.parametrize("size", [10, PACKED_BYTES, PACKED_BYTES + 1, 3 * CHUNK_BYTES])
@pytest.mark.parametrize("where", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("levels", [256, 4], ids=["stored", "compressed"])
def test_a_flipped_bit_is_detected_and_the_payload_is_never_returned(
    store: Store, size: int, where: float, levels: int
) -> None:
    payload = np.random.default_rng(3).integers(0, levels, size, np.uint8).tobytes()
    put(store, header(1), payload)
    flip(store, digest(payload), where)
    with pytest.raises(StorageError, match="corrupt on the disk"):
        store.payload(header(1).id)
    (problem,) = store.verify()
    assert digest(payload) in problem.where
    # Inserting the same content repairs the payload.
    assert put(store, header(2), payload) is Insertion.INSERTED
    assert store.payload(header(1).id) == payload
    assert store.verify() == ()


def flip(store: Store, sha256: str, where: float) -> None:
    """Change one bit of a stored payload; ``where`` is 0 at its first and 1 at its last stored byte."""
    with store._database.read() as connection:
        b = schema.blobs.c
        location, size = connection.execute(select(b.location, b.size).where(b.sha256 == sha256)).one()
    first = 0 if location is None else location - location_range(pack_of(location))[0]
    payloads = store._payloads
    if isinstance(payloads.packs, ObjectPacks):
        key = f"blobs/{sha256[:2]}/{sha256[2:]}" if location is None else f"packs/{pack_of(location):010d}"
        content = bytearray(payloads.packs._store.get(key))
        content[first + int(where * ((len(content) if location is None else size) - 1))] ^= 4
        payloads.packs._store.put(key, bytes(content))
        return
    if location is None:
        path = payloads.files.path(sha256)
        size = path.stat().st_size
    else:
        path = payloads.packs.path(pack_of(location))
    offset = first + int(where * (size - 1))
    with path.open("r+b") as file:
        file.seek(offset)
        changed_byte = bytes([file.read(1)[0] ^ 4])
        file.seek(offset)
        file.write(changed_byte)


def test_a_changed_header_is_detected(store: Store) -> None:
    put(store, header(1))
    put(store, header(2))
    with store._database.write() as connection:
        p = schema.products.c
        connection.execute(update(schema.products).where(p.ordinal == 1).values(header=b"\xc1"))
        connection.execute(update(schema.products).where(p.ordinal == 2).values(t1_ns=p.t1_ns + 1))
    assert [(p.where, p.what[:10]) for p in store.verify()] == [
        (f"product {header(1).id}", "header not"),
        (f"product {header(2).id}", "its row an"),
    ]


def test_a_payload_whose_folder_could_not_be_synced_is_synced_the_next_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files, payload = BlobFiles(tmp_path), b"x" * 100
    folder = files.path(digest(payload)).parent
    folder.mkdir()
    synced: list[Path] = []
    original, broken = os.fsync, True

    def fsync(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        if broken and synced[-1] == folder:
            raise OSError(5, "Input/output error")
        original(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(StorageError, match="the disk failed"):
        files.write(digest(payload), payload, chunk_sums(payload))
    broken = False
    synced.clear()
    files.write(digest(payload), payload, chunk_sums(payload))
    assert synced == [files.path(digest(payload)), folder]
