# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Searches and lookups of an earlier state of the store."""

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from dpm_store import Query, Store
from tests.support.store_products import header, put

AT_ORIGIN = parse_region("bbox:0,0,1,1")


def seqs(store: Store, **conditions: object) -> set[int]:
    return {record.header.seq for record in store.search(Query(**conditions)).items}


def advance_1_s(clock: ManualClock) -> int:
    """Advance the clock by a second; return the previous time."""
    before_ns = clock.now_ns()
    clock.set_ns(before_ns + 1_000_000_000)
    return before_ns


@pytest.mark.req("CDFF-SUP-031")
def test_an_earlier_state_has_products_deleted_since_and_none_inserted_since(
    store: Store, clock: ManualClock
) -> None:
    before_ns = advance_1_s(clock)
    for seq in range(3):
        put(store, header(seq, box_m=(seq, 0, 0, seq + 0.5, 1, 1)))
    full_ns = advance_1_s(clock)
    store.delete(header(0).id)
    put(store, header(3, box_m=(0, 0, 0, 1, 1, 1)))
    for conditions in ({}, {"region": parse_region("bbox:-1,-1,9,9")}):
        assert seqs(store, as_of_ns=before_ns, **conditions) == set()
        assert seqs(store, as_of_ns=full_ns, **conditions) == {0, 1, 2}
        assert seqs(store, **conditions) == {1, 2, 3}
    assert seqs(store, as_of_ns=full_ns, region=AT_ORIGIN) == {0, 1}
    assert seqs(store, as_of_ns=full_ns, region=parse_region("bbox:5,5,6,6")) == set()


def test_an_earlier_state_has_the_earlier_revision_of_a_frame(store: Store, clock: ManualClock) -> None:
    def anchor(x: float) -> None:
        store.frames.set("camp", "site", UncertainTransform(se3.transform(np.eye(3), [x, 0, 0])))

    anchor(0.0)
    put(store, header(0, frame="camp", box_m=(0, 0, 0, 1, 1, 1)))
    before_ns = advance_1_s(clock)
    anchor(100.0)
    assert seqs(store, region=AT_ORIGIN) == set()
    assert seqs(store, region=AT_ORIGIN, as_of_ns=before_ns) == {0}
    assert seqs(store, region=parse_region("bbox:100,0,101,1"), as_of_ns=before_ns) == set()


def test_an_earlier_state_has_its_tags_and_successors(store: Store, clock: ManualClock) -> None:
    for seq in range(2):
        put(store, header(seq))
    first = header(0).id
    store.annotations.update(first, {"tags": ["a_b", "x"]}, if_match=0)
    tagged_ns = advance_1_s(clock)
    store.annotations.update(first, {"tags": ["x"], "superseded_by": header(1).id}, if_match=1)
    assert seqs(store, tags=("a_b",)) == set()
    assert seqs(store, tags=("a_b",), as_of_ns=tagged_ns) == {0}
    assert seqs(store, tags=("aab",), as_of_ns=tagged_ns) == set()
    assert seqs(store, tags=("x",)) == seqs(store, tags=("x", "a_b"), as_of_ns=tagged_ns) == {0}
    assert seqs(store, superseded=False) == {1}
    assert seqs(store, superseded=True) == {0}
    assert seqs(store, superseded=False, as_of_ns=tagged_ns) == {0, 1}


def test_pages_of_an_earlier_state_are_stable_while_products_are_deleted(
    store: Store, clock: ManualClock
) -> None:
    for seq in range(9):
        put(store, header(seq, box_m=(0, 0, 0, 1, 1, 1)))
    before_ns, received, cursor = advance_1_s(clock), [], None
    while True:
        page = store.search(Query(limit=2, as_of_ns=before_ns, cursor=cursor, region=AT_ORIGIN))
        received += [record.header.seq for record in page.items]
        store.delete(page.items[0].id)
        cursor = page.cursor
        if cursor is None:
            break
    assert received == list(range(8, -1, -1))
