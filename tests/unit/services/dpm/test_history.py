# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Changes since a cursor, earlier states, provenance and journals, over HTTP and over the bus."""

from collections.abc import Callable
from typing import Any

import msgpack
import pytest
from fastapi.testclient import TestClient

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError
from services.dpm.bus import service
from services.dpm.bus.history import history
from services.dpm.operations.dpm import Dpm

from .conftest import S, cloud, put_arguments
from .test_annotations import bus_request

InsertedId = Callable[[str], str]


@pytest.mark.req("CDFF-SUP-031")
def test_changes_are_returned_once_from_a_cursor(http: TestClient, dpm: Dpm, inserted_id: InsertedId) -> None:
    first = http.get("/api/v1/changes", params={"limit": 3}).json()
    assert [item["kind"] for item in first["items"]] == ["inserted"] * 3
    assert first["more"]
    dpm.writer.update(inserted_id("dem"), {"tags": ["a"]}, 0)
    dpm.writer.delete(inserted_id("pose"))
    dpm.writer.record("mana", "alarm", {"what": "not a change of the store"})
    second = http.get("/api/v1/changes", params={"since": first["next"]}).json()
    assert [item["kind"] for item in second["items"]] == ["inserted", "updated", "deleted"]
    assert not second["more"]
    third = http.get("/api/v1/changes", params={"since": second["next"]}).json()
    assert (third["items"], third["next"]) == ([], second["next"])
    deletions = msgpack.unpackb(
        service.changes(dpm, bus_request("changes", since="0", kind="deleted")).payload
    )
    assert [item["id"] for item in deletions["items"]] == [inserted_id("pose")]


def test_changes_of_another_kind_are_refused(http: TestClient, dpm: Dpm) -> None:
    assert http.get("/api/v1/changes", params={"kind": "alarm"}).status_code == 422
    with pytest.raises(InputError, match="since"):
        service.changes(dpm, bus_request("changes", since="yesterday"))


def test_an_earlier_state_can_be_queried_over_http(
    http: TestClient, dpm: Dpm, inserted_id: InsertedId, clock: ManualClock
) -> None:
    earlier_ns = clock.now_ns()
    clock.set_ns(earlier_ns + S)
    dpm.writer.delete(inserted_id("dem"))
    for parameters, count in (
        ({"as_of": str(earlier_ns)}, 1),
        ({}, 0),
        ({"as_of": "1970-01-01T00:00:00Z"}, 0),
    ):
        result = http.get("/api/v1/products", params={"type": "dem", "region": "bbox:0,0,1,1"} | parameters)
        assert len(result.json()["items"]) == count, result.text
    assert http.get("/api/v1/frames", params={"as_of": str(earlier_ns)}).json()["items"] == []
    assert http.get("/api/v1/products", params={"superseded": "maybe"}).status_code == 422


def test_products_are_found_by_tag(http: TestClient, dpm: Dpm, inserted_id: InsertedId) -> None:
    dpm.writer.update(inserted_id("dem"), {"tags": ["a", "b"]}, 0)
    for tag, count in (("a", 1), ("a,b", 1), ("a,c", 0)):
        assert len(http.get("/api/v1/products", params={"tag": tag}).json()["items"]) == count


def test_provenance_is_followed_in_both_directions(
    http: TestClient, dpm: Dpm, inserted_id: InsertedId
) -> None:
    _, result = dpm.writer.put(
        *put_arguments(cloud(), "pointcloud", 9, inputs=(inserted_id("dem"), "sample"))
    )
    ancestors = http.get(f"/api/v1/products/{result.id}/provenance").json()
    assert {(item["id"], item["known"]) for item in ancestors["items"]} == {
        (inserted_id("dem"), True),
        ("sample", False),
    }
    descendants = http.get(
        f"/api/v1/products/{inserted_id('dem')}/provenance", params={"direction": "down"}
    ).json()
    assert [(item["id"], item["generation"], item["product"]) for item in descendants["items"]] == [
        (result.id, 1, "pointcloud")
    ]
    url = f"/api/v1/products/{result.id}/provenance"
    assert http.get(url, params={"direction": "sideways"}).status_code == 422
    assert http.get("/api/v1/products/none/provenance").status_code == 404
    over_bus = msgpack.unpackb(service.provenance(dpm, bus_request("provenance", id=result.id)).payload)
    assert [item["id"] for item in over_bus["items"]] == [item["id"] for item in ancestors["items"]]


def test_the_journal_of_another_service_is_stored_once_and_listed_over_both_interfaces(
    http: TestClient, dpm: Dpm
) -> None:
    entry = {
        "number": 3,
        "stamp_ns": 5 * S,
        "scope": "mana",
        "kind": "activation",
        "body": {"dfpc": "mana/dem"},
    }
    body = {"origin": "orchestrator", "entries": [entry]}
    for _ in range(2):
        assert history(dpm, bus_request("history", body)).body() == {"last": 3}
    (item,) = history(dpm, bus_request("history", kind="activation", scope="mana")).body()["items"]
    assert (item["dfpc"], item["origin"], item["number"], item["stamp_ns"]) == (
        "mana/dem",
        "orchestrator",
        3,
        5 * S,
    )
    (over_http,) = http.get("/api/v1/history", params={"kind": "activation", "scope": "mana"}).json()["items"]
    assert over_http == {**item, "stamp_ns": str(5 * S)}


@pytest.mark.parametrize("body", [[1], {"origin": "o"}, {"origin": "o", "entries": [{"number": "x"}]}])
def test_a_malformed_journal_is_refused(dpm: Dpm, body: Any) -> None:
    with pytest.raises(InputError, match="history"):
        history(dpm, bus_request("history", body))
