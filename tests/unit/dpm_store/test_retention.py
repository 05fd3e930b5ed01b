# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import itertools
from contextlib import AbstractContextManager

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError
from cdff_common.interfaces.product import Quality, Status
from dpm_store import Prefer, Query, Rule, Store, retention
from dpm_store.records import Order

from .conftest import NAMES, header, put

S = 1_000_000_000


@pytest.fixture
def aged(store: Store, clock: ManualClock) -> Store:
    """Six products of 100 bytes, 10 to 60 s old."""
    for seq in range(6):
        put(store, header(seq, t1_ns=clock.now_ns() - (60 - 10 * seq) * S), bytes([seq]) * 100)
    return store


def ids(store: Store) -> list[str]:
    return [record.id for record in store.search(Query(order=Order.OLDEST)).items]


@pytest.mark.req("CDFF-SUP-036")
def test_the_old_go_by_age_and_a_dry_run_says_so_and_changes_nothing(aged: Store) -> None:
    all_ids = ids(aged)
    rules = [Rule("dem", max_age_s=35)]
    plan = aged.retention.plan(rules)
    assert [v.product_id for v in plan.retired] == all_ids[:3]
    assert "60 s old" in plan.retired[0].why
    assert plan.bytes == 300
    assert ids(aged) == all_ids
    assert aged.retention.apply(rules) == plan
    assert ids(aged) == all_ids[3:]
    assert aged.collect() == 300
    assert aged.verify() == ()
    assert aged.retention.apply(rules).verdicts == ()


def test_beyond_a_quota_the_oldest_of_each_robot_go(aged: Store, clock: ManualClock) -> None:
    put(aged, header(50, t1_ns=clock.now_ns() - 90 * S), b"x" * 250, robot="minnie")
    rules = [Rule("dem", max_bytes=250)]
    plan = aged.retention.plan(rules)
    assert [(v.robot, v.t1_ns < clock.now_ns() - 25 * S) for v in plan.retired] == [("mana", True)] * 4
    assert {v.robot for v in aged.retention.plan([Rule("dem", "minnie", max_bytes=249)]).retired} == {"minnie"}


def test_what_is_pinned_stays_and_what_it_was_made_from(aged: Store, clock: ManualClock) -> None:
    first, second, third = ids(aged)[:3]
    put(aged, header(20, t1_ns=clock.now_ns(), inputs=(second,)))
    put(aged, header(21, t1_ns=clock.now_ns() - 70 * S, inputs=(third,)))
    aged.annotations.update(header(21, t1_ns=clock.now_ns() - 70 * S).id, {"pinned": True}, if_match=0)
    plan = aged.retention.apply([Rule("dem", max_age_s=35)])
    told = {v.product_id: (v.retire, v.why) for v in plan.verdicts}
    assert told[first][0]
    assert not told[second][0]
    assert told[second][1].startswith("input of")
    assert told[third][1].startswith("input of")
    assert any(why.startswith("pinned") for _, why in told.values())
    assert first not in ids(aged)
    assert {second, third} <= set(ids(aged))


def test_inputs_are_kept_through_products_that_are_gone(aged: Store, clock: ManualClock) -> None:
    first = ids(aged)[0]
    put(aged, header(20, t1_ns=clock.now_ns(), inputs=(first,)))
    put(aged, header(21, t1_ns=clock.now_ns(), inputs=(header(20, t1_ns=clock.now_ns()).id,)))
    aged.delete(header(20, t1_ns=clock.now_ns()).id)
    assert first not in {v.product_id for v in aged.retention.plan([Rule("dem", max_age_s=35)]).retired}


def test_without_a_rule_everything_stays(aged: Store) -> None:
    assert aged.retention.plan([]).verdicts == ()
    assert aged.retention.plan([Rule("pointcloud", max_age_s=1), Rule("dem")]).verdicts == ()


def test_a_quota_counts_over_all_types_where_the_rule_says_so(aged: Store, clock: ManualClock) -> None:
    put(aged, header(50, t1_ns=clock.now_ns()), b"x" * 300, product="pointcloud")
    plan = aged.retention.plan([Rule("*", max_bytes=500)])
    assert plan.going == 4  # the newest 300 and two of 100 bytes stay
    assert "of all types" in plan.retired[0].why
    assert aged.retention.plan([Rule("*", max_count=3)]).going == 4


def test_the_best_stay_where_they_are_preferred(store: Store, clock: ManualClock) -> None:
    t1_ns = clock.now_ns() - 10 * S
    best = header(0, t1_ns=t1_ns, resolution_m=0.05)
    coarse = header(1, t1_ns=t1_ns + S, resolution_m=0.2)
    degraded = header(2, t1_ns=t1_ns + 2 * S, resolution_m=0.05, quality=Quality(Status.DEGRADED))
    replaced = header(3, t1_ns=t1_ns + 3 * S, resolution_m=0.01)
    for one in (best, coarse, degraded, replaced):
        put(store, one)
    store.annotations.update(replaced.id, {"superseded_by": best.id}, if_match=0)
    kept = {}
    for count in (1, 2, 3):
        gone = {v.product_id for v in store.retention.plan([Rule("dem", max_count=count, prefer=Prefer.BEST)]).retired}
        kept[count] = {one.id for one in (best, coarse, degraded, replaced)} - gone
    assert kept == {1: {best.id}, 2: {best.id, coarse.id}, 3: {best.id, coarse.id, degraded.id}}


@pytest.mark.req("CDFF-SUP-036")
def test_density_is_bounded_in_space_and_in_time(store: Store, clock: ManualClock) -> None:
    t1_ns = 100 * S
    for seq in range(12):  # two cells of 10 m on both sides of the origin, three spans of 2 s
        x = 4.0 if seq % 2 else -6.0
        put(store, header(seq, t1_ns=t1_ns + (seq // 2) * S, box_m=(x, 0.0, 0.0, x + 1.0, 1.0, 1.0)))
    clock.set_ns(200 * S)
    by_cell = store.retention.plan([Rule("dem", per_cell=1, cell_m=10.0)])
    assert (by_cell.going, by_cell.staying) == (10, 0)
    assert "cell of 10 m" in by_cell.retired[0].why
    assert store.retention.plan([Rule("dem", per_cell=3, span_s=2.0)]).going == 3
    both = store.retention.apply([Rule("dem", per_cell=1, cell_m=10.0, span_s=2.0)])
    assert both.going == 6
    assert sorted(r.header.seq for r in store.search(Query()).items) == [2, 3, 6, 7, 10, 11]


def test_a_rule_holds_for_one_stream_where_it_names_it(aged: Store, clock: ManualClock) -> None:
    put(aged, header(50, t1_ns=clock.now_ns() - 90 * S), dfpc="lidar", port="scan")
    assert aged.retention.plan([Rule("*", dfpc="lidar", port="scan", max_age_s=20)]).going == 1


def test_a_plan_is_read_as_it_is_told_and_is_explained_to_the_last(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retention, "_PAGE", 7)
    monkeypatch.setattr(retention, "TOLD", 10)
    for seq in range(30):
        put(store, header(seq, t1_ns=(seq // 4) * S))
    rules = [Rule("dem", max_age_s=1.0)]
    plan = store.retention.plan(rules)
    told = list(store.retention.verdicts(rules))
    assert (len(plan.verdicts), plan.going, len(told)) == (10, 30, 30)
    assert len({v.product_id for v in told}) == 30
    assert tuple(told[:10]) == plan.verdicts
    assert [v.t1_ns for v in told] == sorted(v.t1_ns for v in told)


def test_what_is_used_or_pinned_while_retention_runs_stays(aged: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(retention, "_BATCH", 1)
    second, third = ids(aged)[1:3]
    room, calls = aged._database.room, itertools.count()
    freeing = room.freeing

    def and_meanwhile() -> AbstractContextManager[None]:
        if next(calls) == 1:  # between the first deletion and the second
            aged.put(header(60, inputs=(second,)), b"p", **NAMES)
            aged.annotations.update(third, {"pinned": True}, if_match=0)
        return freeing()

    monkeypatch.setattr(room, "freeing", and_meanwhile)
    plan = aged.retention.apply([Rule("dem", max_age_s=35)])
    assert (plan.going, plan.staying) == (1, 2)
    assert {second, third} <= set(ids(aged))


@pytest.mark.parametrize(
    "bounds",
    [
        {"max_age_s": 0}, {"max_bytes": -1}, {"max_age_s": float("nan")}, {"per_cell": 1}, {"cell_m": 1.0},
        {"max_count": 1, "prefer": "oldest"},
    ],
)  # fmt: skip
def test_a_rule_bounds_by_more_than_nothing(bounds: dict[str, float]) -> None:
    with pytest.raises(InputError, match="retention"):
        Rule("dem", **bounds)
