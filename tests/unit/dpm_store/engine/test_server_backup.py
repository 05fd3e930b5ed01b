# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Backups of a store on PostgreSQL with an object store: a dump, and the state at an earlier time."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from dpm_store import Query, Store, open_store
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support import postgresql, seaweedfs
from tests.support.store_products import header, put

pytestmark = pytest.mark.slow
_LIMIT_S = 60.0


@pytest.fixture
def objects() -> Iterator[seaweedfs.ObjectServer]:
    """A running object store."""
    if reason := postgresql.missing() or seaweedfs.missing():
        pytest.skip(reason)
    with seaweedfs.object_server() as server:
        yield server


def payload(seq: int) -> bytes:
    """Return a small payload of an even product, and a large one of an odd one."""
    return bytes([seq]) * (PACKED_BYTES + 1 if seq % 2 else 100)


def insert(store: Store, first: int, end: int) -> None:
    """Insert products, and annotate the first one."""
    for seq in range(first, end):
        put(store, header(seq), payload(seq))
    store.annotations.update(header(first).id, {"notes": f"first of {end - first}"}, if_match=0)


def assert_has(store: Store, end: int) -> None:
    """Assert that a store has the products 0 … end - 1 with their payloads, and nothing else."""
    ids = {header(seq).id for seq in range(end)}
    assert {record.id for record in store.search(Query(limit=100)).items} == ids
    for seq in range(end):
        assert store.payload(header(seq).id) == payload(seq)
    assert store.annotations.get(header(0).id).notes == f"first of {end}"
    assert len(store.events.since()) == end + 1
    assert store.verify() == ()


def copy_objects(source: str, destination: str) -> None:
    """Copy all objects below a prefix of the bucket."""
    import obstore

    bucket = obstore.store.from_url(f"s3://{seaweedfs.BUCKET}", client_options={"allow_http": True})
    for page in obstore.list(bucket, prefix=source):
        for item in page:
            content = obstore.get(bucket, item["path"]).bytes()
            obstore.put(bucket, item["path"].replace(source, destination, 1), bytes(content))


def test_a_dump_and_a_copy_of_the_bucket_are_a_complete_store(
    objects: seaweedfs.ObjectServer, tmp_path: Path, clock: ManualClock
) -> None:
    with postgresql.cluster() as cluster:
        cluster.execute("CREATE DATABASE a")
        cluster.execute("CREATE DATABASE b")
        access = ("-h", str(cluster.folder), "-U", postgresql.USER)
        url = cluster.url("a", tmp_path / "a", f"s3://{seaweedfs.BUCKET}/a")
        with open_store(url, clock) as store:
            insert(store, 0, 6)
            cluster.run("pg_dump", *access, "-Fc", "-f", "dump", "a")
            insert(store, 6, 9)
            copy_objects("a", "b")
        cluster.run("pg_restore", *access, "-d", "b", "--exit-on-error", "dump")
        url = cluster.url("b", tmp_path / "b", f"s3://{seaweedfs.BUCKET}/b")
        with open_store(url, clock) as restored:
            assert_has(restored, 6)
            insert(restored, 6, 8)  # it can be written to


def test_the_state_at_an_earlier_time_is_restored_from_a_base_backup_and_the_log(
    objects: seaweedfs.ObjectServer, tmp_path: Path, clock: ManualClock
) -> None:
    archive = ("archive_mode=on", "archive_command=cp %p ../archive/%f")
    with postgresql.cluster(*archive) as cluster:
        owner = cluster.folder.stat()
        for name in ("archive", "base"):
            (cluster.folder / name).mkdir(mode=0o700)
            os.chown(cluster.folder / name, owner.st_uid, owner.st_gid)
        cluster.execute("CREATE DATABASE a")
        url = cluster.url("a", tmp_path / "a", f"s3://{seaweedfs.BUCKET}/a")
        with open_store(url, clock) as store:
            access = ("-h", str(cluster.folder), "-U", postgresql.USER)
            cluster.run("pg_basebackup", *access, "-D", "base", "-c", "fast", "-X", "none")
            insert(store, 0, 4)
            moment = value_of(cluster, "SELECT clock_timestamp()::text")
            insert(store, 4, 7)
            store.delete(header(1).id)
        last = value_of(cluster, "SELECT pg_walfile_name(pg_switch_wal())")
        wait_for((cluster.folder / "archive" / last).exists)
        cluster.kill()
        use_base_backup(cluster, moment)
        cluster.start()
        wait_for(lambda: value_of(cluster, "SELECT pg_is_in_recovery()::text") == "false")
        with open_store(url, clock) as store:
            assert_has(store, 4)
            insert(store, 10, 11)  # it can be written to


def use_base_backup(cluster: postgresql.Cluster, moment: str) -> None:
    """Replace the data of a stopped server by those of a base backup, to be recovered until a time."""
    (cluster.folder / "data").rename(cluster.folder / "lost")
    (cluster.folder / "base").rename(cluster.folder / "data")
    with (cluster.folder / "data" / "postgresql.auto.conf").open("a") as settings:
        settings.write("restore_command = 'cp ../archive/%f %p'\n")
        settings.write(f"recovery_target_time = '{moment}'\nrecovery_target_action = 'promote'\n")
    (cluster.folder / "data" / "recovery.signal").touch()


def value_of(cluster: postgresql.Cluster, statement: str) -> str:
    """Return the value of a statement on the server."""
    import psycopg

    address = {"host": str(cluster.folder), "user": postgresql.USER, "dbname": "postgres"}
    with psycopg.connect(**address, autocommit=True) as connection:
        row = connection.execute(statement.encode()).fetchone()
    assert row is not None
    return str(row[0])


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait for a condition; fails after the time limit."""
    deadline_s = time.monotonic() + _LIMIT_S
    while not condition():
        assert time.monotonic() < deadline_s, "the condition does not become true"
        time.sleep(0.02)
