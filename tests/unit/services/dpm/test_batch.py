# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import tracemalloc
from typing import Any

import msgpack
import pytest
from fastapi.testclient import TestClient

from cdff_common.bus import Request
from cdff_common.errors import CodecError, InputError
from services.dpm.bus import service
from services.dpm.operations.dpm import Dpm

from .conftest import cloud, elevation, put_arguments


def transmitted(*products: Any) -> list[dict[str, Any]]:
    """Return a batch in the form in which it is sent."""
    return [{**names, "payload": p, "encoding": e, "attachment": a} for names, p, e, a in products]


def batch() -> list[dict[str, Any]]:
    return transmitted(put_arguments(cloud(), "pointcloud", 0), put_arguments(elevation(0.0), "dem", 1))


@pytest.mark.req("CDFF-SUP-030")
def test_a_batch_stored_over_http_and_again_over_the_bus_is_stored_once(http: TestClient, dpm: Dpm) -> None:
    answer = http.post("/api/v1/products/batch", content=msgpack.packb(batch()))
    assert (answer.status_code, [i["result"] for i in answer.json()["items"]]) == (201, ["inserted"] * 2)
    repeated = service.put_all(
        dpm, Request("cdff/@v1/mana/dpm/@rpc/put_all", {}, msgpack.packb(batch()), "", b"")
    )
    assert [i["result"] for i in msgpack.unpackb(repeated.payload)["items"]] == ["already"] * 2
    assert dpm.store.statistics().count == 2


@pytest.mark.parametrize(
    "body", [b"", b"\xc1", b"[]", msgpack.packb([]), msgpack.packb({"a": 1}), msgpack.packb([1])]
)
def test_an_invalid_batch_is_refused(http: TestClient, body: bytes) -> None:
    assert http.post("/api/v1/products/batch", content=body).status_code == 422


@pytest.mark.parametrize(
    "body",
    [[0] * 300_000, [{}] * 300_000, [{f"k{i}": 0 for i in range(300_000)}], [{"robot": "x" * 5_000_000}]],
    ids=["numbers", "empty maps", "many names", "long text"],
)
def test_a_malformed_batch_needs_little_memory_and_gives_a_short_message(dpm: Dpm, body: list[Any]) -> None:
    request = Request("cdff/@v1/ground/dpm/@rpc/put_all", {}, msgpack.packb(body), "", b"")
    tracemalloc.start()
    with pytest.raises(InputError) as refusal:
        service.put_all(dpm, request)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(str(refusal.value)) < 400
    assert peak_bytes < 120e6


def test_a_batch_with_one_unreadable_product_is_not_stored(dpm: Dpm) -> None:
    corrupt = batch()
    corrupt[1]["payload"] = b"\xff" * 40
    request = Request("cdff/@v1/ground/dpm/@rpc/put_all", {}, msgpack.packb(corrupt), "", b"")
    with pytest.raises(CodecError):
        service.put_all(dpm, request)
    assert dpm.store.statistics().count == 0
    assert dpm.events.counters["refused"] == 1


def test_a_robot_inserts_only_its_own_products(dpm: Dpm) -> None:
    request = Request("cdff/@v1/minnie/dpm/@rpc/put_all", {}, msgpack.packb(batch()), "", b"")
    with pytest.raises(InputError, match="minnie"):
        service.put_all(dpm, request)
