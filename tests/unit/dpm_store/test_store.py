# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Opening, closing, locking, migrating, threads and crashes, each on real files."""

import os
import threading
from pathlib import Path

import pytest
from sqlalchemy import insert, select, update

from cdff_common.errors import ConfigurationError, UnavailableError
from dpm_store import Query, Store, open_store
from dpm_store.engine import schema
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support.postgresql import ONLY_EMBEDDED
from tests.support.store_products import header, put


def test_only_one_process_opens_a_data_directory(tmp_path: Path) -> None:
    with open_store(f"sqlite:///{tmp_path}"), pytest.raises(UnavailableError, match=str(os.getpid())):
        open_store(f"sqlite:///{tmp_path}")
    open_store(f"sqlite:///{tmp_path}").close()


@pytest.mark.parametrize("url", ["postgresql://x/y", "sqlite://", "sqlite:///", "data"])
def test_other_urls_are_refused(url: str) -> None:
    with pytest.raises(ConfigurationError, match="sqlite"):
        open_store(url)


@ONLY_EMBEDDED
def test_the_database_is_in_wal_mode_and_syncs_every_commit(store: Store) -> None:
    with store._database.read() as connection:
        pragmas = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous")
        }
    assert pragmas == {"journal_mode": "wal", "synchronous": 2}


def test_read_modify_writes_of_many_threads_lose_nothing(store: Store) -> None:
    counter = select(schema.meta.c.value).where(schema.meta.c.name == "counter")
    with store._database.write() as connection:
        connection.execute(insert(schema.meta), {"name": "counter", "value": "0"})

    def count() -> None:
        for _ in range(25):
            with store._database.write() as connection:
                value = int(connection.execute(counter).scalar_one())
                connection.execute(update(schema.meta).values(value=str(value + 1)))

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with store._database.read() as connection:
        assert connection.execute(counter).scalar_one() == "100"


def test_readers_do_not_wait_for_a_writer(store: Store) -> None:
    put(store, header(0))
    with store._database.write() as connection:
        connection.exec_driver_sql("INSERT INTO meta VALUES ('x', 'y')")
        answer: list[int] = []
        reader = threading.Thread(target=lambda: answer.append(len(store.search(Query()).items)))
        reader.start()
        reader.join(5)
        assert answer == [1]


def test_the_same_product_from_many_threads_is_inserted_once(store: Store) -> None:
    results: list[str] = []
    payload = b"z" * (PACKED_BYTES + 1)
    threads = [
        threading.Thread(target=lambda: results.append(str(put(store, header(0), payload)))) for _ in range(6)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(results) == ["already"] * 5 + ["inserted"]
