# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import itertools
import random
from contextlib import AbstractContextManager

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError
from cdff_common.interfaces.product import Header, Quality, Status
from dpm_store import Query, Rule, Store
from dpm_store.history import retention
from dpm_store.products.records import Order
from tests.support.store_products import header, put

S = 1_000_000_000


@pytest.fixture
def aged_store(store: Store, clock: ManualClock) -> Store:
    """Six products of 100 bytes, 10 to 60 s old."""
    for seq in range(6):
        put(store, header(seq, t1_ns=clock.now_ns() - (60 - 10 * seq) * S), bytes([seq]) * 100)
    return store


def ids(store: Store) -> list[str]:
    return [record.id for record in store.search(Query(order=Order.OLDEST)).items]


@pytest.mark.req("CDFF-SUP-036")
def test_old_products_are_deleted_and_a_plan_changes_nothing(aged_store: Store) -> None:
    all_ids = ids(aged_store)
    rules = [Rule(product="dem", max_age_s=35)]
    plan = aged_store.retention.plan(rules)
    assert [v.id for v in plan.retired] == all_ids[:3]
    assert "60 s old" in plan.retired[0].why
    assert plan.bytes == 300
    assert ids(aged_store) == all_ids
    assert aged_store.retention.apply(rules) == plan
    assert ids(aged_store) == all_ids[3:]
    assert aged_store.collect() == 300
    assert aged_store.verify() == ()
    assert aged_store.retention.apply(rules).decisions == ()


def test_the_oldest_products_beyond_a_quota_are_deleted(aged_store: Store, clock: ManualClock) -> None:
    put(aged_store, header(50, t1_ns=clock.now_ns() - 90 * S), b"x" * 250, robot="minnie")
    rules = [Rule(product="dem", max_bytes=250)]
    plan = aged_store.retention.plan(rules)
    assert [(v.robot, v.t1_ns < clock.now_ns() - 25 * S) for v in plan.retired] == [("mana", True)] * 4
    assert {
        v.robot
        for v in aged_store.retention.plan([Rule(product="dem", robot="minnie", max_bytes=249)]).retired
    } == {"minnie"}


def test_a_number_of_products_counts_each_robot_alone(aged_store: Store, clock: ManualClock) -> None:
    for seq in (50, 51, 52):
        put(aged_store, header(seq, t1_ns=clock.now_ns() - 90 * S), robot="minnie")
    retired = aged_store.retention.plan([Rule(product="dem", max_count=4)]).retired
    assert [v.robot for v in retired] == ["mana", "mana"]


def test_pinned_products_and_their_inputs_stay(aged_store: Store, clock: ManualClock) -> None:
    first, second, third = ids(aged_store)[:3]
    put(aged_store, header(20, t1_ns=clock.now_ns(), inputs=(second,)))
    put(aged_store, header(21, t1_ns=clock.now_ns() - 70 * S, inputs=(third,)))
    aged_store.annotations.update(header(21, t1_ns=clock.now_ns() - 70 * S).id, {"pinned": True}, if_match=0)
    plan = aged_store.retention.apply([Rule(product="dem", max_age_s=35)])
    results = {v.id: (v.retire, v.why) for v in plan.decisions}
    assert results[first][0]
    assert not results[second][0]
    assert results[second][1].startswith("input of")
    assert results[third][1].startswith("input of")
    assert any(why.startswith("pinned") for _, why in results.values())
    assert first not in ids(aged_store)
    assert {second, third} <= set(ids(aged_store))


def test_inputs_are_kept_through_deleted_products(aged_store: Store, clock: ManualClock) -> None:
    first = ids(aged_store)[0]
    put(aged_store, header(20, t1_ns=clock.now_ns(), inputs=(first,)))
    put(aged_store, header(21, t1_ns=clock.now_ns(), inputs=(header(20, t1_ns=clock.now_ns()).id,)))
    aged_store.delete(header(20, t1_ns=clock.now_ns()).id)
    assert first not in {v.id for v in aged_store.retention.plan([Rule(product="dem", max_age_s=35)]).retired}


def test_an_input_that_is_stored_after_its_product_is_kept(store: Store, clock: ManualClock) -> None:
    """A synchronised store receives products in any order."""
    old = header(1, t1_ns=clock.now_ns() - 60 * S)
    put(store, header(0, t1_ns=clock.now_ns(), inputs=(old.id,)))
    put(store, old)
    plan = store.retention.apply([Rule(product="dem", max_age_s=35)])
    assert (plan.to_delete, plan.to_keep) == (0, 1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_in_a_random_provenance_graph_exactly_the_needed_inputs_stay(
    store: Store, clock: ManualClock, seed: int
) -> None:
    rng = random.Random(seed)
    stamps = [clock.now_ns() - rng.randrange(100) * S for _ in range(60)]
    headers: list[Header] = []
    for seq, t1_ns in enumerate(stamps):
        inputs = tuple(h.id for h in rng.sample(headers, min(len(headers), rng.randrange(3))))
        headers.append(header(seq, t1_ns=t1_ns, inputs=inputs))
        put(store, headers[-1])
    pinned, deleted = {h.id for h in rng.sample(headers, 3)}, {h.id for h in rng.sample(headers, 10)}
    for product_id in pinned - deleted:
        store.annotations.update(product_id, {"pinned": True}, if_match=0)
    for product_id in deleted:
        store.delete(product_id)

    old_ids = {h.id for h in headers if h.t1_ns < clock.now_ns() - 35 * S}
    needed: set[str] = set()
    for h in reversed(headers):  # a product has only earlier inputs
        stays = h.id not in deleted and (h.id not in old_ids or h.id in pinned)
        if stays or h.id in needed:
            needed |= set(h.inputs)
    plan = store.retention.plan([Rule(product="dem", max_age_s=35)])
    assert {v.id for v in plan.retired} == old_ids - deleted - pinned - needed
    assert {v.id for v in plan.decisions} == old_ids - deleted


def test_without_a_rule_everything_stays(aged_store: Store) -> None:
    assert aged_store.retention.plan([]).decisions == ()
    assert (
        aged_store.retention.plan([Rule(product="pointcloud", max_age_s=1), Rule(product="dem")]).decisions
        == ()
    )


def test_a_quota_can_count_all_types(aged_store: Store, clock: ManualClock) -> None:
    put(aged_store, header(50, t1_ns=clock.now_ns()), b"x" * 300, product="pointcloud")
    plan = aged_store.retention.plan([Rule(product="*", max_bytes=500)])
    assert plan.to_delete == 4  # the newest 300 and two of 100 bytes stay
    assert "of all types" in plan.retired[0].why
    assert aged_store.retention.plan([Rule(product="*", max_count=3)]).to_delete == 4


def test_the_best_products_stay_if_preferred(store: Store, clock: ManualClock) -> None:
    t1_ns = clock.now_ns() - 10 * S
    best = header(0, t1_ns=t1_ns, resolution_m=0.05)
    coarse = header(1, t1_ns=t1_ns + S, resolution_m=0.2)
    degraded = header(2, t1_ns=t1_ns + 2 * S, resolution_m=0.05, quality=Quality(Status.DEGRADED))
    replaced = header(3, t1_ns=t1_ns + 3 * S, resolution_m=0.01)
    for product_header in (best, coarse, degraded, replaced):
        put(store, product_header)
    store.annotations.update(replaced.id, {"superseded_by": best.id}, if_match=0)
    results = {}
    for count in (1, 2, 3):
        deleted = {
            v.id for v in store.retention.plan([Rule(product="dem", max_count=count, prefer="best")]).retired
        }
        results[count] = {
            product_header.id for product_header in (best, coarse, degraded, replaced)
        } - deleted
    assert results == {1: {best.id}, 2: {best.id, coarse.id}, 3: {best.id, coarse.id, degraded.id}}


@pytest.mark.req("CDFF-SUP-036")
def test_the_density_is_limited_in_space_and_in_time(store: Store, clock: ManualClock) -> None:
    t1_ns = 100 * S
    for seq in range(12):  # two cells of 10 m on both sides of the origin, three spans of 2 s
        x = 4.0 if seq % 2 else -6.0
        put(store, header(seq, t1_ns=t1_ns + (seq // 2) * S, box_m=(x, 0.0, 0.0, x + 1.0, 1.0, 1.0)))
    clock.set_ns(200 * S)
    by_cell = store.retention.plan([Rule(product="dem", per_cell=1, cell_m=10.0)])
    assert (by_cell.to_delete, by_cell.to_keep) == (10, 0)
    assert "cell of 10 m" in by_cell.retired[0].why
    assert store.retention.plan([Rule(product="dem", per_cell=3, span_s=2.0)]).to_delete == 3
    both = store.retention.apply([Rule(product="dem", per_cell=1, cell_m=10.0, span_s=2.0)])
    assert both.to_delete == 6
    assert sorted(r.header.seq for r in store.search(Query()).items) == [2, 3, 6, 7, 10, 11]


def test_a_rule_can_apply_to_one_stream(aged_store: Store, clock: ManualClock) -> None:
    put(aged_store, header(50, t1_ns=clock.now_ns() - 90 * S), dfpc="lidar", port="scan")
    assert (
        aged_store.retention.plan([Rule(product="*", dfpc="lidar", port="scan", max_age_s=20)]).to_delete == 1
    )


def test_every_decision_of_a_plan_is_read_in_pages_with_a_reason(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retention, "_PAGE", 7)
    monkeypatch.setattr(retention, "MAX_DECISIONS", 10)
    for seq in range(30):
        put(store, header(seq, t1_ns=(seq // 4) * S))
    rules = [Rule(product="dem", max_age_s=1.0)]
    plan = store.retention.plan(rules)
    received = list(store.retention.decisions(rules))
    assert (len(plan.decisions), plan.to_delete, len(received)) == (10, 30, 30)
    assert len({v.id for v in received}) == 30
    assert tuple(received[:10]) == plan.decisions
    assert [v.t1_ns for v in received] == sorted(v.t1_ns for v in received)


def test_products_used_or_pinned_during_retention_stay(
    aged_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retention, "_BATCH", 1)
    second, third = ids(aged_store)[1:3]
    disk_space, calls = aged_store._database.disk_space, itertools.count()
    deletion = disk_space.deletion

    def change_between_deletions() -> AbstractContextManager[None]:
        if next(calls) == 1:  # between the first deletion and the second
            put(aged_store, header(60, inputs=(second,)), b"p")
            aged_store.annotations.update(third, {"pinned": True}, if_match=0)
        return deletion()

    monkeypatch.setattr(disk_space, "deletion", change_between_deletions)
    plan = aged_store.retention.apply([Rule(product="dem", max_age_s=35)])
    assert (plan.to_delete, plan.to_keep) == (1, 2)
    assert {second, third} <= set(ids(aged_store))


@pytest.mark.parametrize(
    "bounds",
    [
        {"max_age_s": 0},
        {"max_bytes": -1},
        {"max_age_s": float("nan")},
        {"per_cell": 1},
        {"cell_m": 1.0},
        {"max_count": 1, "prefer": "oldest"},
    ],
)
def test_bounds_of_a_rule_are_positive(bounds: dict[str, float]) -> None:
    with pytest.raises(InputError, match="retention rule: "):
        Rule(**{"product": "dem", **bounds})
