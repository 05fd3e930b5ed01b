# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The history: what is entered stays, other services' journals exactly once."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from dpm_store import Store
from dpm_store.events import Entry


def entry(number: int, **body: object) -> Entry:
    return Entry(number, number * 1000, "mana", "activation", body)


def test_a_journal_sent_again_and_again_is_entered_once(store: Store) -> None:
    assert store.events.append_from("orchestrator", [entry(1, dfpc="a"), entry(2, dfpc="b")]) == 2
    assert store.events.append_from("orchestrator", [entry(1, dfpc="a"), entry(2, dfpc="b"), entry(5, dfpc="c")]) == 5
    assert store.events.append_from("orchestrator", [entry(4, dfpc="late")]) == 5
    kept = store.events.since(kind="activation", scope="mana")
    assert [(e.body["number"], e.body["dfpc"], e.stamp_ns) for e in kept] == [
        (1, "a", 1000),
        (2, "b", 2000),
        (5, "c", 5000),
    ]


def test_journals_of_two_origins_do_not_disturb_each_other(store: Store) -> None:
    store.events.append_from("orchestrator/mana", [entry(7)])
    assert store.events.append_from("orchestrator/minnie", [entry(1)]) == 1
    assert [e.body["origin"] for e in store.events.since()] == ["orchestrator/mana", "orchestrator/minnie"]


@pytest.mark.parametrize("bad", [[entry(2), entry(1)], [entry(1, blob=object())], [Entry(1, 0, "../x", "job", {})]])
def test_a_call_that_cannot_be_kept_keeps_nothing(store: Store, bad: list[Entry]) -> None:
    with pytest.raises(InputError):
        store.events.append_from("orchestrator", [*bad])
    assert store.events.last_ordinal() == 0
    assert store.events.append_from("orchestrator", [entry(1)]) == 1


def test_the_history_is_asked_for_by_kind_and_scope(store: Store) -> None:
    store.events.append("mana", "job", {})
    store.events.append("minnie", "job", {})
    store.events.append("minnie", "alarm", {})
    assert [e.scope for e in store.events.since(kind=("job", "alarm"), scope="minnie")] == ["minnie", "minnie"]
    assert [e.scope for e in store.events.since(kind="job")] == ["mana", "minnie"]
