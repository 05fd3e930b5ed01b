# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The robot, the ground, or both annotate and delete products; contact windows exchange the changes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import CodecError, ConflictError, StorageError
from cdff_common.interfaces.contact_plan import ContactPlan
from cdff_dev.contact.generated_products import product
from dpm_store import Event
from dpm_store.exchange.ledger import AnnouncedRow, ChangeRow, Ledger, RequestRow
from dpm_store.history.events import Actor, acting
from services.contact import robot_end
from services.contact.changes import OLDEST, GroundChanges, apply_on_robot, with_values
from services.contact.ground_end import GroundEnd
from services.contact.requests import DeferredRequests, prune
from services.dpm.operations.dpm import Dpm
from tests.unit.services.contact.test_exchange import CLOUD, MAP, Ends, ends, is_at_ground, wait_until, window

__all__ = ["ends"]
ROBOT, OPERATOR = Actor("mana", "robot", "zenoh"), Actor("alice", "operator", "http")
NUMBERS = (0, 1, 2, MAP)


def id_of(number: int) -> str:
    return product(1, number).header.id


def annotate(dpm: Dpm, actor: Actor, number: int, **changes: Any) -> None:
    with acting(actor):
        dpm.writer.update(id_of(number), changes, None, actor.name)


def delete(dpm: Dpm, actor: Actor, number: int) -> None:
    with acting(actor):
        dpm.writer.delete(id_of(number))


def annotation(dpm: Dpm, number: int) -> dict[str, Any]:
    values = dpm.store.annotations.get(id_of(number)).to_dict()
    return {name: values[name] for name in ("tags", "notes", "pinned")}


def contact(ends: Ends, exit_stack: ExitStack, **exchange: Any) -> GroundEnd:
    """Start both ends in an open window."""
    plan = ContactPlan(windows=(window(0, 100),))
    ground: GroundEnd = exit_stack.enter_context(ends.start_ground(plan))
    exit_stack.enter_context(ends.start_robot(plan, **exchange))
    return ground


@pytest.fixture
def exchanged(ends: Ends) -> Ends:
    """Two ends whose products are exchanged."""
    ends.robot.store.put_all([product(1, n) for n in NUMBERS])
    with ExitStack() as exit_stack:
        contact(ends, exit_stack)
        wait_until(lambda: is_at_ground(ends, *NUMBERS))
    return ends


def test_annotations_and_deletions_of_the_robot_are_applied_at_the_ground(exchanged: Ends) -> None:
    annotate(exchanged.robot, ROBOT, MAP, tags=["crater"], notes="steep in the north")
    delete(exchanged.robot, ROBOT, 0)
    exchanged.robot.store.delete(id_of(1))  # by retention: no caller
    with ExitStack() as exit_stack:
        contact(exchanged, exit_stack)
        wait_until(lambda: not is_at_ground(exchanged, 0))
        wait_until(lambda: annotation(exchanged.ground, MAP)["tags"] == ["crater"])
    assert annotation(exchanged.ground, MAP)["notes"] == "steep in the north"
    assert is_at_ground(exchanged, 1, 2)
    (event,) = exchanged.ground.store.events.since(kind="deleted")
    assert event.body["by"] == "contact/robot/mana"


def test_annotations_and_deletions_of_the_ground_are_applied_on_the_robot(exchanged: Ends) -> None:
    with ExitStack() as exit_stack:
        ground = contact(exchanged, exit_stack)
        annotate(exchanged.ground, OPERATOR, MAP, tags=["landing"], pinned=True)
        delete(exchanged.ground, OPERATOR, 0)
        delete(exchanged.ground, OPERATOR, 2)
        wait_until(lambda: not exchanged.robot.store.live([id_of(0), id_of(2)]))
        wait_until(lambda: annotation(exchanged.robot, MAP)["pinned"])
        wait_until(lambda: {r["state"] for r in ground.requests.everything()} == {"answered"})
    assert annotation(exchanged.robot, MAP) == {"tags": ["landing"], "notes": "", "pinned": True}
    assert exchanged.robot.store.live([id_of(1)])
    assert exchanged.robot.store.annotations.get(id_of(MAP)).author == "alice"


def test_a_field_that_the_ground_has_set_keeps_its_value_on_both_sides(exchanged: Ends) -> None:
    annotate(exchanged.ground, OPERATOR, MAP, tags=["ground"])  # out of contact: neither side has both
    annotate(exchanged.robot, ROBOT, MAP, tags=["robot"], notes="of the robot")
    expected = {"tags": ["ground"], "notes": "of the robot", "pinned": False}
    with ExitStack() as exit_stack:
        ground = contact(exchanged, exit_stack)
        wait_until(lambda: annotation(exchanged.ground, MAP) == expected)
        wait_until(lambda: annotation(exchanged.robot, MAP) == expected)
        wait_until(lambda: {r["state"] for r in ground.requests.everything()} == {"answered"})
        annotate(exchanged.robot, ROBOT, MAP, tags=["robot_again"])
        wait_until(lambda: annotation(exchanged.robot, MAP)["tags"] == ["ground"])
    assert annotation(exchanged.ground, MAP) == expected


@pytest.mark.slow
def test_a_change_waits_for_its_product(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, CLOUD)])
    annotate(ends.robot, ROBOT, CLOUD, notes="dust")
    with ExitStack() as exit_stack:
        ground = contact(ends, exit_stack)
        wait_until(lambda: ground._ledger.changes("mana") or is_at_ground(ends, CLOUD))
        wait_until(lambda: is_at_ground(ends, CLOUD) and annotation(ends.ground, CLOUD)["notes"] == "dust")
        wait_until(lambda: not ground._ledger.changes("mana"))


@pytest.mark.slow
def test_a_product_that_is_pinned_at_the_ground_is_not_deleted_and_the_history_states_why(
    exchanged: Ends,
) -> None:
    annotate(exchanged.ground, OPERATOR, 0, pinned=True)
    delete(exchanged.robot, ROBOT, 0)
    with ExitStack() as exit_stack:
        contact(exchanged, exit_stack)
        wait_until(lambda: exchanged.ground.store.events.since(kind="change_refused"))
    (event,) = exchanged.ground.store.events.since(kind="change_refused")
    assert (event.body["id"], event.body["change"]) == (id_of(0), "deleted")
    assert "pinned" in event.body["reason"]
    assert is_at_ground(exchanged, 0)


@pytest.mark.slow
def test_notes_that_do_not_fit_in_a_datagram_are_refused_with_the_reason(exchanged: Ends) -> None:
    annotate(exchanged.ground, OPERATOR, MAP, notes="x" * 2000, tags=["long"])
    with ExitStack() as exit_stack:
        contact(exchanged, exit_stack)
        wait_until(lambda: annotation(exchanged.robot, MAP)["tags"] == ["long"])
        wait_until(lambda: exchanged.ground.store.events.since(kind="change_refused"))
    (event,) = exchanged.ground.store.events.since(kind="change_refused")
    assert "fits in one datagram" in event.body["reason"]
    assert annotation(exchanged.robot, MAP)["notes"] == ""


@pytest.mark.parametrize(
    "body",
    [
        {"change": "update", "id": "a", "values": "{"},
        {"change": "update", "id": "a", "values": "[1]"},
        {"change": "delete"},
    ],
)
def test_a_change_that_cannot_be_read_is_refused(exchanged: Ends, body: dict[str, str]) -> None:
    with pytest.raises(CodecError, match="cannot be read"):
        apply_on_robot(exchanged.robot, body)


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    """Ledger of the ground, without ends."""
    (tmp_path / "ledger").mkdir()
    with closing(Ledger(tmp_path / "ledger")) as ledger:
        yield ledger


def requests_of(ends: Ends, ledger: Ledger) -> DeferredRequests:
    return DeferredRequests(ends.ground, ledger, ContactPlan(windows=(window(0, 100),)))


def test_a_pinned_product_of_the_robot_does_not_keep_the_others_from_deletion(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, n) for n in (0, 1, 2)])
    annotate(ends.robot, ROBOT, 1, pinned=True)
    ids = [id_of(n) for n in (0, 1, 2)]
    with pytest.raises(ConflictError, match=f"product {id_of(1)} is pinned"):
        apply_on_robot(ends.robot, {"change": "delete", "ids": ",".join(ids)})
    assert ends.robot.store.live(ids) == {id_of(1)}


def test_the_next_change_of_a_field_is_sent_when_the_robot_has_the_previous_one(
    ends: Ends, ledger: Ledger
) -> None:
    ends.ground.store.put_all([product(1, n) for n in (0, 1)])
    requests = requests_of(ends, ledger)
    changes = GroundChanges(ends.ground, ledger, ["mana"], requests.add_change)
    for number, values in ((0, {"notes": "a"}), (0, {"notes": "b", "tags": ["b"]}), (1, {"notes": "c"})):
        annotate(ends.ground, OPERATOR, number, **values)
    changes.scan()
    first = {(row.body["id"], row.body["values"]): row.id for row in requests.open("mana")}
    notes = (id_of(0), '{"notes": "a"}')
    assert set(first) == {notes, (id_of(0), '{"tags": ["b"]}'), (id_of(1), '{"notes": "c"}')}
    requests.taken(first[notes])
    assert '{"notes": "b"}' in {row.body["values"] for row in requests.open("mana")}


def test_changes_of_one_time_stay_in_their_order(
    ends: Ends, ledger: Ledger, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ends.ground.clock, "now_ns", lambda: 1_700_000_000 * 10**9)
    ends.ground.store.put_all([product(1, 0)])
    requests = requests_of(ends, ledger)
    changes = GroundChanges(ends.ground, ledger, ["mana"], requests.add_change)
    texts = [f"note {k}" for k in range(12)]  # their events have ordinals of one and of two digits
    for text in texts:
        annotate(ends.ground, OPERATOR, 0, notes=text)
    changes.scan()
    assert [row.body["values"] for row in ledger.requests()] == [f'{{"notes": "{text}"}}' for text in texts]


def test_values_go_back_to_two_robots_whose_changes_have_the_same_number(ends: Ends, ledger: Ledger) -> None:
    ends.ground.store.put_all([product(1, n) for n in (0, 1)])
    requests = requests_of(ends, ledger)
    changes = GroundChanges(ends.ground, ledger, ["mana"], requests.add_change)
    for number in (0, 1):
        annotate(ends.ground, OPERATOR, number, notes="ground")
    changes.scan()
    for row in requests.open("mana"):
        requests.result(row.id, {})
    for robot, number in (("mana", 0), ("minnie", 1)):
        ledger.add_changes(robot, [ChangeRow(5, id_of(number), "updated", {"notes": "robot"})])
        changes.apply(robot)
    kept = ledger.requests("kept")
    assert {(row.robot, row.body["id"]) for row in kept} == {("mana", id_of(0)), ("minnie", id_of(1))}
    assert {row.body["values"] for row in kept} == {'{"notes": "ground"}'}


def test_a_change_of_a_product_that_was_deleted_at_the_ground_does_not_wait_for_it(
    ends: Ends, ledger: Ledger
) -> None:
    ends.ground.store.put_all([product(1, 0)])
    ends.ground.store.delete(id_of(0))
    changes = GroundChanges(ends.ground, ledger, ["mana"], requests_of(ends, ledger).add_change)
    rows = [ChangeRow(5 + n, id_of(n), "updated", {"notes": "robot"}) for n in (0, 1)]
    ledger.add_changes("mana", rows)
    changes.apply("mana")
    assert ledger.changes("mana") == rows[1:]  # product 1 has not arrived


def test_a_change_of_a_product_that_the_robot_will_not_send_is_removed(ends: Ends, ledger: Ledger) -> None:
    changes = GroundChanges(ends.ground, ledger, ["mana"], requests_of(ends, ledger).add_change)
    rows = [ChangeRow(5 + n, id_of(n), "updated", {"notes": "robot"}) for n in (0, 1, 2)]
    ledger.add_changes("mana", rows)
    changes.apply("mana")
    assert ledger.changes("mana") == rows  # the robot has not reported its oldest product
    ledger.set_note(f"{OLDEST}/mana", 7)
    changes.apply("mana", lambda product_id: product_id == id_of(1))
    assert ledger.changes("mana") == rows[1:]  # product 1 is on its way, and change 7 is not older


@pytest.mark.slow
def test_changes_of_a_product_that_was_deleted_before_the_contact_are_not_kept(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, n) for n in (0, 1)])
    annotate(ends.robot, ROBOT, 0, notes="dust")
    delete(ends.robot, ROBOT, 0)
    with ExitStack() as exit_stack:
        ground = contact(ends, exit_stack)
        wait_until(lambda: is_at_ground(ends, 1) and ground._ledger.note(f"{OLDEST}/mana", 0) > 4)
        wait_until(lambda: not ground._ledger.changes("mana"))
    assert not is_at_ground(ends, 0)


def test_a_change_whose_revision_is_missing_has_the_newest_values(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, 0)])
    annotate(ends.robot, ROBOT, 0, notes="newest")
    body = {"id": id_of(0), "changed": ["notes"], "revision": 7}
    assert with_values(Event(1, 0, "mana", "updated", body), ends.robot.store).body["values"] == {
        "notes": "newest"
    }
    body["id"] = id_of(1)  # purged, with its annotations
    assert with_values(Event(1, 0, "mana", "updated", body), ends.robot.store).body["values"] == {}


def test_a_change_is_applied_on_the_robot_as_soon_as_its_disk_has_space(
    exchanged: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer, tries = exchanged.robot.writer, list[int]()
    update = writer.update

    def full(*arguments: Any) -> Any:
        tries.append(len(tries))
        if len(tries) < 3:
            raise StorageError("no space left on the disk")
        return update(*arguments)

    monkeypatch.setattr(robot_end, "_STORAGE_S", 0.05)
    monkeypatch.setattr(writer, "update", full)
    annotate(exchanged.ground, OPERATOR, MAP, notes="of the ground")
    with ExitStack() as exit_stack:
        ground = contact(exchanged, exit_stack)
        wait_until(lambda: {r["state"] for r in ground.requests.everything()} == {"answered"})
    assert annotation(exchanged.robot, MAP)["notes"] == "of the ground"
    assert len(tries) == 3


DAY_NS = 86_400 * 10**9


def test_requests_that_ended_long_ago_are_removed_and_open_ones_are_kept(ledger: Ledger) -> None:
    now_ns = 1000 * DAY_NS

    def add(name: str, state: str, days: int, **body: str) -> None:
        row = RequestRow(name, "mana", state, now_ns - days * DAY_NS, now_ns, {"type": "dem"} | body, None)
        assert ledger.add_request(row)

    add("kept", "kept", 100)
    add("old", "answered", 61)
    add("new", "failed", 59)
    add("change_old", "answered", 2, change="update")
    add("change_new", "answered", 0, change="update")
    add("change_kept", "kept", 2, change="update")
    prune(ledger, now_ns)
    assert {row.id for row in ledger.requests()} == {"kept", "new", "change_new", "change_kept"}


def test_requests_are_read_by_state_robot_expiry_and_number(ledger: Ledger) -> None:
    for n in range(6):
        robot, state = ("mana", "minnie")[n % 2], ("kept", "accepted")[n // 4]
        ledger.add_request(RequestRow(str(n), robot, state, n, 10 + n, {"type": "dem"}, None))
    assert [row.id for row in ledger.requests("kept", robot="mana")] == ["0", "2"]
    assert [row.id for row in ledger.requests("kept", robot="mana", limit=1)] == ["0"]
    assert [row.id for row in ledger.requests("kept", "accepted", expired_ns=11)] == ["0", "1"]
    found = ledger.request("4")
    assert found is not None
    assert (found.robot, found.body) == ("mana", {"type": "dem"})
    assert ledger.request("6") is None


def test_a_robot_with_another_store_has_no_changes_of_the_previous_one(ledger: Ledger) -> None:
    ledger.announce("mana", [AnnouncedRow(1, 0, 10, b"")])
    for robot in ("mana", "minnie"):
        ledger.add_changes(robot, [ChangeRow(5, "a", "deleted", {})])
    ledger.clear("mana")
    assert (ledger.announced("mana"), ledger.changes("mana"), len(ledger.changes("minnie"))) == ([], [], 1)
