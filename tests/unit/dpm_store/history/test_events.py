# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The history: entries are permanent, and entries of other services' journals are appended once."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from dpm_store import Event, Store


def entry(number: int, **body: object) -> Event:
    return Event(number, number * 1000, "mana", "activation", body)


def test_a_journal_that_is_sent_repeatedly_is_appended_once(store: Store) -> None:
    assert store.events.append_from("orchestrator", [entry(1, dfpc="a"), entry(2, dfpc="b")]) == 2
    assert (
        store.events.append_from("orchestrator", [entry(1, dfpc="a"), entry(2, dfpc="b"), entry(5, dfpc="c")])
        == 5
    )
    assert store.events.append_from("orchestrator", [entry(4, dfpc="late")]) == 5
    events = store.events.since(kind="activation", scope="mana")
    assert [(e.body["number"], e.body["dfpc"], e.stamp_ns) for e in events] == [
        (1, "a", 1000),
        (2, "b", 2000),
        (5, "c", 5000),
    ]


def test_journals_of_two_origins_are_independent(store: Store) -> None:
    store.events.append_from("orchestrator/mana", [entry(7)])
    assert store.events.append_from("orchestrator/minnie", [entry(1)]) == 1
    assert [e.body["origin"] for e in store.events.since()] == ["orchestrator/mana", "orchestrator/minnie"]


@pytest.mark.parametrize(
    "bad", [[entry(2), entry(1)], [entry(1, blob=object())], [Event(1, 0, "../x", "job", {})]]
)
def test_an_invalid_journal_appends_nothing(store: Store, bad: list[Event]) -> None:
    with pytest.raises(InputError):
        store.events.append_from("orchestrator", [*bad])
    assert store.events.last_ordinal() == 0
    assert store.events.append_from("orchestrator", [entry(1)]) == 1


def test_an_event_with_a_body_above_64_kilobytes_is_refused(store: Store) -> None:
    store.events.append("mana", "job", {"text": "x" * (2**16 - 100)})
    with pytest.raises(InputError, match=r"event job: body of 65[0-9]{3} bytes, expected at most 65536"):
        store.events.append("mana", "job", {"text": "x" * 2**16})
    assert store.events.last_ordinal() == 1


def test_the_history_is_filtered_by_kind_and_scope(store: Store) -> None:
    store.events.append("mana", "job", {})
    store.events.append("minnie", "job", {})
    store.events.append("minnie", "alarm", {})
    assert [e.scope for e in store.events.since(kind=("job", "alarm"), scope="minnie")] == [
        "minnie",
        "minnie",
    ]
    assert [e.scope for e in store.events.since(kind="job")] == ["mana", "minnie"]
