# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import msgpack
import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Request
from cdff_common.errors import CodecError, InputError
from services.dpm import service
from services.dpm.operations import Dpm

from .conftest import cloud, elevation, parcel


def travelling(*parcels: Any) -> list[dict[str, Any]]:
    """A batch as it travels."""
    return [{**names, "payload": p, "encoding": e, "attachment": a} for names, p, e, a in parcels]


def batch() -> list[dict[str, Any]]:
    return travelling(parcel(cloud(), "pointcloud", 0), parcel(elevation(0.0), "dem", 1))


@pytest.mark.req("CDFF-SUP-030")
def test_a_batch_is_stored_over_http_and_again_over_the_bus_changes_nothing(http: TestClient, dpm: Dpm) -> None:
    answer = http.post("/api/v1/products/batch", content=msgpack.packb(batch()))
    assert (answer.status_code, [i["result"] for i in answer.json()["items"]]) == (201, ["inserted"] * 2)
    again = service.put_all(dpm, Request("cdff/@v1/mana/dpm/@rpc/put_all", {}, msgpack.packb(batch()), "", b""))
    assert [i["result"] for i in msgpack.unpackb(again.payload)["items"]] == ["already"] * 2
    assert dpm.store.statistics().count == 2


@pytest.mark.parametrize("body", [b"", b"\xc1", b"[]", msgpack.packb([]), msgpack.packb({"a": 1}), msgpack.packb([1])])
def test_what_is_no_batch_is_a_problem(http: TestClient, body: bytes) -> None:
    assert http.post("/api/v1/products/batch", content=body).status_code == 422


def test_of_a_batch_with_one_that_cannot_be_read_nothing_is_stored(dpm: Dpm) -> None:
    spoiled = batch()
    spoiled[1]["payload"] = b"\xff" * 40
    request = Request("cdff/@v1/ground/dpm/@rpc/put_all", {}, msgpack.packb(spoiled), "", b"")
    with pytest.raises(CodecError):
        service.put_all(dpm, request)
    assert dpm.store.statistics().count == 0
    assert dpm.counters["refused"] == 1


def test_a_robot_puts_its_own_products_only(dpm: Dpm) -> None:
    request = Request("cdff/@v1/minnie/dpm/@rpc/put_all", {}, msgpack.packb(batch()), "", b"")
    with pytest.raises(InputError, match="minnie"):
        service.put_all(dpm, request)
