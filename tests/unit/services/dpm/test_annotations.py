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
from services.dpm import service
from services.dpm.operations import OWN_EVENTS, Dpm

Filled = Callable[[str], str]


def asked(verb: str, body: Any = None, **parameters: str) -> Request:
    """A query as it comes from the bus."""
    payload = b"" if body is None else msgpack.packb(body)
    return Request(f"cdff/@v1/ground/dpm/@rpc/{verb}", parameters, payload, "", b"")


@pytest.mark.req("CDFF-SUP-030")
def test_an_update_needs_the_revision_that_it_was_made_from(http: TestClient, filled: Filled) -> None:
    url = f"/api/v1/products/{filled('dem')}"
    read = http.get(url)
    assert (read.headers["etag"], read.json()["annotation"]["tags"]) == ('"r0"', [])
    assert http.patch(url, json={"tags": ["crater"]}).status_code == 428
    changed = http.patch(url, json={"tags": ["crater"], "notes": "odd"}, headers={"If-Match": '"r0"'})
    assert (changed.status_code, changed.headers["etag"]) == (200, '"r1"')
    late = http.patch(url, json={"notes": "other"}, headers={"If-Match": '"r0"'})
    assert late.status_code == 412
    assert late.headers["content-type"].startswith("application/problem+json")
    assert "revision 1" in late.json()["detail"]
    any_ = http.patch(url, json={"pinned": True, "quality": {"status": "DEGRADED"}}, headers={"If-Match": "*"})
    assert any_.json()["revision"] == 2
    now = http.get(url).json()["annotation"]
    assert (now["tags"], now["notes"], now["pinned"], now["quality"]["status"]) == (["crater"], "odd", True, "DEGRADED")
    assert [r["revision"] for r in http.get(url + "/revisions").json()["items"]] == [1, 2]
    assert http.delete(url).status_code == 409


def test_a_product_that_somebody_changed_since_is_not_deleted(http: TestClient, filled: Filled) -> None:
    url = f"/api/v1/products/{filled('dem')}"
    read = http.get(url).headers["etag"]
    changed = http.patch(url, json={"notes": "keep this"}, headers={"If-Match": read}).headers["etag"]
    assert http.delete(url, headers={"If-Match": read}).status_code == 412
    assert http.delete(url, headers={"If-Match": "yesterday's"}).status_code == 422
    assert http.get(url).json()["annotation"]["notes"] == "keep this"
    assert http.delete(url, headers={"If-Match": changed}).json()["deleted"]


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
def test_what_an_annotation_cannot_hold_is_a_problem(
    http: TestClient, filled: Filled, body: dict[str, Any], match: str
) -> None:
    url = f"/api/v1/products/{filled('dem')}"
    answer = http.patch(url, json=body, headers={"If-Match": match})
    assert answer.status_code == 422, answer.text
    assert http.get(url).headers["etag"] == '"r0"'


def test_a_product_that_is_not_there_cannot_be_annotated(http: TestClient) -> None:
    answer = http.patch("/api/v1/products/none", json={"notes": "x"}, headers={"If-Match": "*"})
    assert answer.status_code == 404
    assert http.get("/api/v1/products/none/revisions").status_code == 404


def test_an_update_over_the_bus_is_told_to_everybody(dpm: Dpm, filled: Filled) -> None:
    product_id = filled("dem")
    told: list[Event] = []
    dpm.listen(told.append)
    reply = service.update(dpm, asked("update", {"tags": ["a"]}, id=product_id, if_match="0", author="anna"))
    said = msgpack.unpackb(reply.payload)
    assert (said["revision"], said["tags"], said["author"]) == (1, ["a"], "anna")
    assert [(e.kind, e.scope, e.body["changed"]) for e in told] == [("updated", "mana", ["tags"])]
    assert told[0].kind in OWN_EVENTS
    with pytest.raises(StaleRevisionError):
        service.update(dpm, asked("update", {"tags": []}, id=product_id, if_match="0"))
    for wrong in ({"if_match": "x"}, {}):
        with pytest.raises(InputError, match="if_match"):
            service.update(dpm, asked("update", {"tags": []}, id=product_id, **wrong))
    history = msgpack.unpackb(service.update(dpm, asked("update", id=product_id)).payload)
    assert [r["revision"] for r in history["revisions"]] == [1]
