# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Callable
from typing import Any

import msgpack
import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Request
from cdff_common.errors import InputError
from dpm_store import Event, StaleRevisionError
from services.dpm.bus import service
from services.dpm.operations.dpm import OWN_EVENTS, Dpm

InsertedId = Callable[[str], str]


def bus_request(verb: str, body: Any = None, **parameters: str) -> Request:
    """Return a query in the form that the bus delivers."""
    payload = b"" if body is None else msgpack.packb(body)
    return Request(f"cdff/@v1/ground/dpm/@rpc/{verb}", parameters, payload, "", b"")


@pytest.mark.req("CDFF-SUP-030")
def test_an_update_requires_its_base_revision(http: TestClient, inserted_id: InsertedId) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}"
    read = http.get(url)
    assert (read.headers["etag"], read.json()["annotation"]["tags"]) == ('"r0"', [])
    assert http.patch(url, json={"tags": ["crater"]}).status_code == 428
    changed = http.patch(url, json={"tags": ["crater"], "notes": "odd"}, headers={"If-Match": '"r0"'})
    assert (changed.status_code, changed.headers["etag"]) == (200, '"r1"')
    outdated = http.patch(url, json={"notes": "other"}, headers={"If-Match": '"r0"'})
    assert outdated.status_code == 412
    assert outdated.headers["content-type"].startswith("application/problem+json")
    assert "revision 1" in outdated.json()["detail"]
    unconditional = http.patch(
        url, json={"pinned": True, "quality": {"status": "DEGRADED"}}, headers={"If-Match": "*"}
    )
    assert unconditional.json()["revision"] == 2
    annotation = http.get(url).json()["annotation"]
    assert (
        annotation["tags"],
        annotation["notes"],
        annotation["pinned"],
        annotation["quality"]["status"],
    ) == (
        ["crater"],
        "odd",
        True,
        "DEGRADED",
    )
    assert [r["revision"] for r in http.get(url + "/revisions").json()["items"]] == [1, 2]
    assert http.delete(url).status_code == 409


def test_a_deletion_based_on_an_outdated_revision_is_refused(
    http: TestClient, inserted_id: InsertedId
) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}"
    first_etag = http.get(url).headers["etag"]
    second_etag = http.patch(url, json={"notes": "keep this"}, headers={"If-Match": first_etag}).headers[
        "etag"
    ]
    assert http.delete(url, headers={"If-Match": first_etag}).status_code == 412
    assert http.delete(url, headers={"If-Match": "yesterday's"}).status_code == 422
    assert http.get(url).json()["annotation"]["notes"] == "keep this"
    assert http.delete(url, headers={"If-Match": second_etag}).json()["deleted"]


@pytest.mark.parametrize(
    ("body", "match"),
    [
        ({"tags": ["../x"]}, '"r0"'),
        ({"payload": "x"}, '"r0"'),
        ({}, '"r0"'),
        ({"quality": {"status": "SUPERB"}}, '"r0"'),
        ({"notes": "x"}, '"x"'),
    ],
)
def test_an_invalid_annotation_is_refused(
    http: TestClient, inserted_id: InsertedId, body: dict[str, Any], match: str
) -> None:
    url = f"/api/v1/products/{inserted_id('dem')}"
    answer = http.patch(url, json=body, headers={"If-Match": match})
    assert answer.status_code == 422, answer.text
    assert http.get(url).headers["etag"] == '"r0"'


def test_an_unknown_product_cannot_be_annotated(http: TestClient) -> None:
    answer = http.patch("/api/v1/products/none", json={"notes": "x"}, headers={"If-Match": "*"})
    assert answer.status_code == 404
    assert http.get("/api/v1/products/none/revisions").status_code == 404


def test_an_update_over_the_bus_is_published_as_an_event(dpm: Dpm, inserted_id: InsertedId) -> None:
    product_id = inserted_id("dem")
    received: list[Event] = []
    dpm.events.listen(received.append)
    reply = service.update(
        dpm, bus_request("update", {"tags": ["a"]}, id=product_id, if_match="0", author="anna")
    )
    document = msgpack.unpackb(reply.payload)
    assert (document["revision"], document["tags"], document["author"]) == (1, ["a"], "anna")
    assert [(e.kind, e.scope, e.body["changed"]) for e in received] == [("updated", "mana", ["tags"])]
    assert received[0].kind in OWN_EVENTS
    with pytest.raises(StaleRevisionError):
        service.update(dpm, bus_request("update", {"tags": []}, id=product_id, if_match="0"))
    for wrong in ({"if_match": "x"}, {}):
        with pytest.raises(InputError, match="if_match"):
            service.update(dpm, bus_request("update", {"tags": []}, id=product_id, **wrong))
    history = msgpack.unpackb(service.update(dpm, bus_request("update", id=product_id)).payload)
    assert [r["revision"] for r in history["revisions"]] == [1]
