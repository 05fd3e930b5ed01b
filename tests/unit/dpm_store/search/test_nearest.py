# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search by distance: order, pages, regions and growing squares, against the distances of all products."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry.region import parse_region
from dpm_store import Query, Store
from dpm_store.products.records import Order
from tests.support.store_products import header, put

QUERY = Query(limit=3, order=Order.NEAREST, point=(0.0, 0.0))


def pages(store: Store, query: Query) -> tuple[list[int], list[float], int]:
    """Return sequence numbers and distances of all pages, and the number of pages."""
    numbers: list[int] = []
    distances: list[float] = []
    for count in range(1, 100):
        page = store.search(query)
        numbers += [record.header.seq for record in page.items]
        distances += page.distances_m
        if page.cursor is None:
            return numbers, distances, count
        query = replace(query, cursor=page.cursor)
    raise AssertionError("the pages do not end")


def fill(store: Store, x_m: np.ndarray) -> None:
    for seq, x in enumerate(x_m.tolist()):
        put(store, header(seq, box_m=(x, 0.0, 0.0, x + 1.0, 1.0, 1.0)))


def test_products_of_all_distances_are_returned_once_and_nearest_first(store: Store) -> None:
    """The nearest of them are in the first square, the farthest far beyond it."""
    x_m = np.array([5000.0, 3.0, 0.5, -4.5, 70.0, 600.0, -90.0])
    fill(store, x_m)
    expected = np.where(x_m > 0.0, x_m, -(x_m + 1.0))
    numbers, distances, count = pages(store, QUERY)
    assert numbers == np.argsort(expected).tolist()
    assert distances == pytest.approx(np.sort(expected))
    assert count == 3


def test_a_last_page_that_is_full_has_no_cursor(store: Store) -> None:
    fill(store, np.arange(1.0, 7.0))
    assert pages(store, QUERY)[2] == 2
    assert pages(store, replace(QUERY, limit=6))[2] == 1


def test_products_of_equal_distance_are_newest_first(store: Store) -> None:
    for seq in range(8):
        put(store, header(seq, t1_ns=1000 * (seq // 2), box_m=(2.0, 0.0, 0.0, 3.0, 1.0, 1.0)))
    numbers, distances, _ = pages(store, QUERY)
    assert numbers == [7, 6, 5, 4, 3, 2, 1, 0]
    assert distances == [2.0] * 8


def test_many_products_at_one_distance_hide_no_farther_ones(store: Store) -> None:
    fill(store, np.concatenate([np.full(40, 2.0), [3.0, 2.5]]))
    numbers, distances, _ = pages(store, QUERY)
    assert sorted(numbers[:40]) == list(range(40))
    assert numbers[40:] == [41, 40]
    assert distances[-3:] == [2.0, 2.5, 3.0]


def test_without_a_point_the_centre_of_the_region_counts(store: Store) -> None:
    fill(store, np.array([0.0, 4.0, 9.0, 30.0]))
    query = Query(limit=10, order=Order.NEAREST, region=parse_region("bbox:0,0,20,1"))
    numbers, distances, _ = pages(store, query)
    assert numbers == [2, 1, 0]  # the centre is at 10 m, the last product beyond the region
    assert distances == pytest.approx([0.0, 5.0, 9.0])


def test_an_empty_store_has_no_nearest_product(store: Store) -> None:
    page = store.search(QUERY)
    assert (page.items, page.cursor, page.distances_m) == ((), None, ())
