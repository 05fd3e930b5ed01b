# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import itertools
import threading
from concurrent.futures import ThreadPoolExecutor, wait

import pytest

from dpm_store import Query, Rule, StaleRevisionError, Store
from tests.support.store_products import header, put

WRITERS, TIMES = 8, 15


@pytest.mark.req("CDFF-SUP-173")
@pytest.mark.slow
def test_eight_threads_lose_no_update_while_retention_and_collection_run(store: Store) -> None:
    put(store, header(0), b"counted")
    seqs, updates_ended = itertools.count(1), threading.Event()

    def write() -> None:
        for _ in range(TIMES):
            count_up(store, header(0).id)
            put(store, header(next(seqs)), b"dem")
            put(store, header(next(seqs)), b"image", product="image")

    def retain_and_collect() -> None:
        while not updates_ended.is_set():
            store.retention.apply([Rule(product="image", max_count=5)])
            store.collect()

    with ThreadPoolExecutor(WRITERS + 1) as threads:
        maintenance = threads.submit(retain_and_collect)
        writers = [threads.submit(write) for _ in range(WRITERS)]
        wait(writers)
        updates_ended.set()
        for future in (maintenance, *writers):
            future.result()
    assert store.annotations.get(header(0).id).notes == str(WRITERS * TIMES)
    assert store.annotations.get(header(0).id).revision == WRITERS * TIMES
    assert len(store.search(Query(types=("dem",), limit=1000)).items) == 1 + WRITERS * TIMES
    assert store.verify() == ()


def count_up(store: Store, product_id: str) -> None:
    """Increment the number in the notes of a product; repeat after a conflict."""
    while True:
        annotation = store.annotations.get(product_id)
        try:
            store.annotations.update(
                product_id, {"notes": str(int(annotation.notes or 0) + 1)}, if_match=annotation.revision
            )
            return
        except StaleRevisionError:
            continue
