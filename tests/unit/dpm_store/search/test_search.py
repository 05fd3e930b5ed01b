# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cdff_common.clock import ManualClock
from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import Region, parse_region
from cdff_common.interfaces.product import Quality, Status
from dpm_store import Query, Store, open_store
from dpm_store.products.records import NewProduct, Order
from dpm_store.search.outlines import touches
from tests.support.store_products import NAMES, header, put


def sequence_numbers(store: Store, **query: object) -> list[int]:
    """Return the sequence numbers of all results of a search, from all pages."""
    seqs: list[int] = []
    cursor = None
    while True:
        page = store.search(Query(**{"limit": 7, **query, "cursor": cursor}))  # type: ignore[arg-type]
        seqs += [record.header.seq for record in page.items]
        cursor = page.cursor
        if cursor is None:
            return seqs


def test_a_search_without_conditions_gives_everything_newest_first(store: Store) -> None:
    for seq in (3, 1, 2, 0):
        put(store, header(seq))
    assert sequence_numbers(store) == [3, 2, 1, 0]
    assert sequence_numbers(store, order=Order.OLDEST) == [0, 1, 2, 3]


@pytest.mark.req("CDFF-SUP-031", "CDFF-SUP-035")
def test_each_condition_restricts_the_results(store: Store) -> None:
    put(store, header(0))
    put(store, header(1), robot="minnie")
    put(store, header(2), product="pointcloud", type_name="Pointcloud", port="cloud")
    put(store, header(3, resolution_m=0.5, config_hash="other"), dfpc="other")
    put(store, header(4, quality=Quality(Status.DEGRADED), child="mana/base"))
    assert sequence_numbers(store, types=("dem",)) == [4, 3, 1, 0]
    assert sequence_numbers(store, types=("dem", "pointcloud")) == [4, 3, 2, 1, 0]
    assert sequence_numbers(store, robot="minnie") == [1]
    assert sequence_numbers(store, port="cloud") == [2]
    assert sequence_numbers(store, dfpc="other") == [3]
    assert sequence_numbers(store, status="DEGRADED") == [4]
    assert sequence_numbers(store, child="mana/base") == [4]
    assert sequence_numbers(store, config_hash="other") == [3]
    assert sequence_numbers(store, resolution_max_m=0.5) == [3]
    assert sequence_numbers(store, resolution_max_m=0.4) == []
    assert sequence_numbers(store, inserted_after=store.get(header(2).id).ordinal) == [4, 3]


def test_a_time_interval_finds_overlapping_captures_with_ends_included(store: Store) -> None:
    put(store, header(0, t1_ns=10_000, t0_ns=5_000))
    put(store, header(1, t1_ns=20_000, t0_ns=15_000))
    assert sequence_numbers(store, t0_ns=10_000, t1_ns=15_000) == [1, 0]
    assert sequence_numbers(store, t0_ns=11_000, t1_ns=14_000) == []
    assert sequence_numbers(store, t0_ns=16_000) == [1]
    assert sequence_numbers(store, t1_ns=14_000) == [0]


def test_pages_neither_repeat_nor_skip_during_changes(store: Store) -> None:
    for seq in range(20):
        put(store, header(seq, t1_ns=(seq // 3) * 1000, box_m=(0, 0, 0, 1, 1, 1)))
    received: list[int] = []
    cursor, region = None, parse_region("bbox:0,0,1,1")
    for turn in itertools.count():
        page = store.search(Query(limit=4, cursor=cursor, region=region))
        received += [record.header.seq for record in page.items]
        put(store, header(100 + turn, t1_ns=10_000_000, box_m=(0, 0, 0, 1, 1, 1)))
        if turn == 1:
            store.delete(page.items[-1].id)
        cursor = page.cursor
        if cursor is None:
            break
    assert received == sorted(range(20), key=lambda seq: (seq // 3, seq), reverse=True)


@pytest.mark.parametrize("cursor", ["", "x", "AAAA", "%%%", "a" * 5000])
def test_a_malformed_cursor_is_refused(store: Store, cursor: str) -> None:
    with pytest.raises(InputError, match="cursor"):
        store.search(Query(cursor=cursor))


@pytest.mark.req("CDFF-SUP-081", "CDFF-SUP-082")
@pytest.mark.parametrize("order", list(Order))
def test_pages_keep_the_frames_of_the_first_during_a_re_anchoring(store: Store, order: Order) -> None:
    def shift(x_m: float) -> UncertainTransform:
        return UncertainTransform(se3.transform(np.eye(3), [x_m, 0, 0]))

    store.frames.set("mana/odom", "site", shift(0.0))
    for seq in range(9):
        put(store, header(seq, frame="mana/odom", box_m=(seq, 0, 0, seq + 1, 1, 1)))
    query, received, cursor = Query(limit=2, region=parse_region("bbox:-1,-1,20,2"), order=order), [], None
    while True:
        page = store.search(replace(query, cursor=cursor))
        received += [record.header.seq for record in page.items]
        store.frames.set("mana/odom", "site", shift(100.0 * len(received)))
        cursor = page.cursor
        if cursor is None:
            break
    assert sorted(received) == list(range(9))
    assert store.search(query).items == ()
    assert len(store.search(replace(query, limit=9, frames_revision=1)).items) == 9


def test_a_cursor_of_the_other_order_is_refused(store: Store) -> None:
    for seq in range(3):
        put(store, header(seq))
    cursor = store.search(Query(limit=1)).cursor
    with pytest.raises(InputError, match="order"):
        store.search(Query(limit=1, cursor=cursor, order=Order.OLDEST))


@pytest.mark.parametrize("limit", [0, -1, 1001])
def test_page_sizes_are_limited(limit: int) -> None:
    with pytest.raises(InputError, match="limit"):
        Query(limit=limit)


coordinate = st.floats(-50, 50, allow_subnormal=False)
size = st.floats(0, 20, allow_subnormal=False)
boxes = st.builds(
    lambda x, y, z, a, b, c: (x, y, z, x + a, y + b, z + c),
    coordinate,
    coordinate,
    coordinate,
    size,
    size,
    size,
)
regions = st.one_of(
    st.builds(
        lambda x, y, a, b: Region("bbox", (x, y, x + a + 0.1, y + b + 0.1)),
        coordinate,
        coordinate,
        size,
        size,
    ),
    st.builds(lambda b: Region("box", (*b[:3], b[3] + 0.1, b[4] + 0.1, b[5] + 0.1)), boxes),
    st.builds(lambda x, y, r: Region("circle", (x, y, r + 0.1)), coordinate, coordinate, size),
    st.builds(
        lambda x, y, a, b: Region("polygon", (x, y, x + a + 0.1, y, x + a / 2, y + b + 0.1)),
        coordinate,
        coordinate,
        size,
        size,
    ),
)
poses = st.builds(
    lambda t, rpy: se3.transform(se3.exp_so3(rpy), t),
    st.tuples(coordinate, coordinate, coordinate),
    st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)),
)


@pytest.mark.slow
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    products=st.lists(
        st.tuples(boxes, st.integers(0, 20), st.sampled_from(["site", "mana/odom", "minnie/odom"])),
        max_size=25,
    ),
    region=regions,
    span=st.tuples(st.integers(0, 20), st.integers(0, 20)),
    frame=st.sampled_from(["site", "mana/odom"]),
    T_mana=poses,
    T_minnie=poses,
)
def test_a_search_by_region_and_time_equals_a_check_of_each_product(
    tmp_path_factory: pytest.TempPathFactory,
    products: list,
    region: Region,
    span: tuple[int, int],
    frame: str,
    T_mana: np.ndarray,
    T_minnie: np.ndarray,
) -> None:
    t0, t1 = sorted(span)
    with open_store(f"sqlite:///{tmp_path_factory.mktemp('store')}", ManualClock()) as store:
        store.frames.set("mana/odom", "site", UncertainTransform(T_mana))
        store.frames.set("minnie/odom", "site", UncertainTransform(T_minnie))
        for seq, (box, time_s, product_frame) in enumerate(products):
            put(store, header(seq, box_m=box, t1_ns=time_s * 10**9, frame=product_frame))
        expected = []
        for seq, (box, time_s, product_frame) in enumerate(products):
            T = store.poses.at(0, frame, product_frame).matrix
            if t0 <= time_s <= t1 and touches(region, np.array([box]), T)[0]:
                expected.append(seq)
        received = sequence_numbers(store, region=region, frame=frame, t0_ns=t0 * 10**9, t1_ns=t1 * 10**9)
    assert sorted(received) == expected


@given(region=regions, box=boxes, T=poses)
@settings(max_examples=150, deadline=None)
def test_a_box_with_points_in_a_region_touches_it(
    region: Region, box: tuple[float, ...], T: np.ndarray
) -> None:
    rng = np.random.default_rng(1)
    low, high = np.array(box[:3]), np.array(box[3:])
    points = se3.transform_points(T, low + rng.uniform(size=(200, 3)) * (high - low))
    inside = region.contains(points[:, 0], points[:, 1], points[:, 2])
    if inside.any():
        assert touches(region, np.array([box]), T)[0]


def test_a_box_outside_a_circle_or_polygon_but_within_its_bounds_is_not_found(store: Store) -> None:
    put(store, header(0, box_m=(0.9, 0.9, 0, 1.0, 1.0, 0)))
    assert sequence_numbers(store, region=parse_region("circle:0,0,1")) == []
    assert sequence_numbers(store, region=parse_region("circle:0,0,1.3")) == [0]
    assert sequence_numbers(store, region=parse_region("polygon:0,0,1,0,0,1")) == []
    assert sequence_numbers(store, region=parse_region("polygon:0,0,2,0,0,2")) == [0]


def test_times_years_after_the_first_product_are_found_to_the_microsecond(store: Store) -> None:
    first, year = 1_789_000_000 * 10**9, 365 * 86_400 * 10**9
    put(store, header(0, t1_ns=first, box_m=(0, 0, 0, 1, 1, 1)))
    put(store, header(1, t1_ns=first + year, box_m=(0, 0, 0, 1, 1, 1)))
    region = parse_region("bbox:0,0,1,1")
    assert sequence_numbers(store, region=region, t0_ns=first + year) == [1]
    assert sequence_numbers(store, region=region, t0_ns=first + year + 1000) == []
    assert sequence_numbers(store, region=region, t1_ns=first - 1000) == []


@pytest.mark.parametrize("order", [Order.NEWEST, Order.OLDEST])
def test_many_products_of_nearly_one_time_are_found_once_and_in_order(store: Store, order: Order) -> None:
    s, box = 1_000_000_000, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    stamps = [s, *(2 * s + i // 3 * 1000 for i in range(60)), *(3 * s + i * s // 4 for i in range(60))]
    new_products = [
        NewProduct(header(i, t1_ns=t, box_m=box), bytes([i]), **NAMES) for i, t in enumerate(stamps)
    ]
    store.put_all(new_products)
    expected = sorted(range(len(stamps)), key=lambda i: (stamps[i], i), reverse=order is Order.NEWEST)
    for limit in (1, 5, 40):
        assert (
            sequence_numbers(store, region=Region("bbox", (-1e4, -1e4, 1e4, 1e4)), limit=limit, order=order)
            == expected
        )


def test_coordinates_far_from_the_origin_are_compared_exactly(store: Store) -> None:
    put(store, header(0, box_m=(4_590_000.25, 0, 0, 4_590_000.5, 1, 1)))
    assert sequence_numbers(store, region=parse_region("bbox:4590000.5,0,4590001,1")) == [0]
    assert sequence_numbers(store, region=parse_region("bbox:4590000.5001,0,4590001,1")) == []


def test_a_corrected_frame_moves_its_products(store: Store) -> None:
    store.frames.set("mana/odom", "site", UncertainTransform.identity())
    put(store, header(0, box_m=(0, 0, 0, 1, 1, 1), frame="mana/odom"))
    old_region, new_region = parse_region("bbox:0,0,1,1"), parse_region("bbox:100,0,101,1")
    assert (sequence_numbers(store, region=old_region), sequence_numbers(store, region=new_region)) == (
        [0],
        [],
    )
    store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [100, 0, 0])))
    assert (sequence_numbers(store, region=old_region), sequence_numbers(store, region=new_region)) == (
        [],
        [0],
    )


def test_unconnected_frames_are_listed(store: Store) -> None:
    put(store, header(0, box_m=(0, 0, 0, 1, 1, 1)))
    put(store, header(1, box_m=(0, 0, 0, 1, 1, 1), frame="lost/base"))
    page = store.search(Query(region=parse_region("bbox:0,0,1,1")))
    assert [r.header.seq for r in page.items] == [0]
    assert page.unplaced_frames == ("lost/base",)


def test_products_without_a_box_are_not_found_by_region(store: Store) -> None:
    put(store, header(0))
    assert sequence_numbers(store, region=parse_region("bbox:-100,-100,100,100")) == []
    assert sequence_numbers(store) == [0]


def test_a_region_near_a_frame_is_around_its_position(store: Store) -> None:
    put(store, header(0, box_m=(10, 0, 0, 11, 1, 1)))
    put(store, header(1, box_m=(0, 0, 0, 1, 1, 1)))
    store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [9, 0, 0])))
    assert sequence_numbers(store, region=parse_region("near:mana/odom,3")) == [0]
    with pytest.raises(FrameNotFoundError):
        sequence_numbers(store, region=parse_region("near:nowhere,3"))


def test_the_index_survives_closing_and_opening(tmp_path: Path, new_store: Callable[[Path], str]) -> None:
    url = new_store(tmp_path / "data")
    with open_store(url) as store:
        put(store, header(0, box_m=(0, 0, 0, 1, 1, 1)))
    with open_store(url) as store:
        assert sequence_numbers(store, region=parse_region("bbox:0,0,1,1")) == [0]
        assert store.verify() == ()
