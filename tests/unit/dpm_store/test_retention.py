# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError
from dpm_store import Query, Rule, Store

from .conftest import header, put

S = 1_000_000_000


@pytest.fixture
def aged(store: Store, clock: ManualClock) -> Store:
    """Six products of 100 bytes, 10 to 60 s old."""
    for seq in range(6):
        put(store, header(seq, t1_ns=clock.now_ns() - (60 - 10 * seq) * S), bytes([seq]) * 100)
    return store


def ids(store: Store) -> list[str]:
    return [record.id for record in store.search(Query(oldest_first=True)).items]


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


@pytest.mark.parametrize("bounds", [{"max_age_s": 0}, {"max_bytes": -1}, {"max_age_s": float("nan")}])
def test_a_rule_bounds_by_more_than_nothing(bounds: dict[str, float]) -> None:
    with pytest.raises(InputError, match="retention"):
        Rule("dem", **bounds)
