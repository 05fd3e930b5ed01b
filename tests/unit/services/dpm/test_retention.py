# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Iterator
from typing import Any

import pytest

from cdff_common.bus import Reply, Request
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile
from dpm_store import Event, Rule
from services.dpm.bus.retention import retention, rules_of
from services.dpm.operations.dpm import Dpm

from .conftest import cloud, elevation, put_arguments

RULES = (Rule(product="pointcloud", max_age_s=50),)


def retention_request(**parameters: str) -> Request:
    return Request("cdff/@v1/ground/dpm/@rpc/retention", parameters, b"", "", b"")


def final(replies: Reply | Iterator[Reply]) -> Any:
    """Return the body of the last reply."""
    return (replies if isinstance(replies, Reply) else list(replies)[-1]).body()


@pytest.mark.req("CDFF-SUP-036")
def test_retention_explains_by_default_and_deletes_on_request(dpm: Dpm) -> None:
    _, expired = dpm.writer.put(*put_arguments(cloud(), "pointcloud", 10))
    dpm.writer.put(*put_arguments(cloud(), "pointcloud", 90))
    dpm.writer.put(*put_arguments(elevation(0.0), "dem", 1))
    events: list[Event] = []
    dpm.events.listen(events.append)
    plan = final(retention(dpm, RULES, retention_request()))
    assert (plan["applied"], plan["retired"], plan["rules"]) == (False, 1, 1)
    (decision,) = plan["verdicts"]
    assert (decision["id"], decision["retire"]) == (expired.id, True)
    assert "90 s old" in decision["why"]
    assert dpm.store.statistics().count == 3
    result = final(retention(dpm, RULES, retention_request(apply="true")))
    assert (result["applied"], result["bytes"]) == (True, plan["bytes"])
    assert dpm.store.statistics().count == 2
    assert [event.kind for event in events] == ["deleted"]


def test_every_decision_is_listed_in_pages_before_the_totals(
    dpm: Dpm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.dpm.bus.retention.MAX_DECISIONS", 2)
    for seq in range(5):
        dpm.writer.put(*put_arguments(cloud(), "pointcloud", seq))
    *pages, totals = retention(dpm, RULES, retention_request(all="true"))
    assert [(len(page.body()["verdicts"]), page.final) for page in pages] == [
        (2, False),
        (2, False),
        (1, False),
    ]
    assert (totals.body()["retired"], totals.body()["verdicts"], totals.final) == (5, [], True)


def test_a_value_other_than_true_and_false_is_refused(dpm: Dpm) -> None:
    with pytest.raises(InputError, match="apply"):
        retention(dpm, RULES, retention_request(apply="yes"))


def test_the_rules_are_those_of_the_profile() -> None:
    profile = Profile.model_validate(
        {
            "name": "test",
            "robots": [{"id": "mana"}],
            "retention": [{"product": "dem", "max_age_s": 5, "max_bytes": 9}],
        }
    )
    assert rules_of(profile) == (Rule(product="dem", max_age_s=5.0, max_bytes=9),)
    assert rules_of(None) == ()
