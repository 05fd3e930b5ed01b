# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls of the DPM by the orchestrator: the newest product of a search, transferred once."""

from __future__ import annotations

import math
from typing import Any

from cdff_common.bus import Reply
from cdff_common.errors import ProductNotFoundError
from cdff_common.interfaces.product import Header
from services.orchestrator.dpm import DpmClient
from tests.support.dpm_products import pose, put_arguments


class BusDouble:
    """DPM whose newest pose was captured at ``t_s``; None: no pose."""

    def __init__(self) -> None:
        self.t_s: int | None = None
        self.calls: list[dict[str, Any]] = []

    def call(self, key: str, parameters: dict[str, Any], *, timeout_s: float) -> Reply:
        assert key.endswith("dpm/@rpc/get")
        self.calls.append(parameters)
        if self.t_s is None:
            raise ProductNotFoundError("no product of that kind")
        child = str(parameters.get("child", "mana/base"))
        _, payload, encoding, attachment = put_arguments(
            pose(self.t_s, float(self.t_s)), "pose", self.t_s, child=child
        )
        metadata = Header.from_attachment(attachment).to_dict()
        if metadata["id"] == parameters.get("known"):
            return Reply.of({"id": metadata["id"]}, **metadata, kind="reference")
        return Reply(payload, encoding, {**metadata, "kind": "product"})


def test_the_newest_product_is_one_call_and_transferred_once() -> None:
    bus = BusDouble()
    dpm = DpmClient(bus)  # type: ignore[arg-type]  # double
    assert dpm.newest(math.inf, "mana", type="pose") is None
    bus.t_s = 3
    first = dpm.newest(math.inf, "mana", type="pose")
    assert first is not None
    assert dpm.newest(math.inf, "mana", type="pose") is first
    assert dpm.value(first.header.id, "mana", math.inf) is first
    bus.t_s = 4
    second = dpm.newest(math.inf, "mana", type="pose")
    assert second is not None
    assert second.header.id != first.header.id
    known = [call.get("known") for call in bus.calls]
    assert known == [None, None, first.header.id, first.header.id]


def test_the_newest_products_of_other_searches_are_not_mixed() -> None:
    bus = BusDouble()
    dpm = DpmClient(bus)  # type: ignore[arg-type]  # double
    bus.t_s = 3
    for child in ("mana/base", "mana/camera"):
        dpm.newest(math.inf, "mana", type="pose", child=child)
    assert [call.get("known") for call in bus.calls] == [None, None]


def test_a_product_that_is_no_longer_kept_is_transferred_again() -> None:
    bus = BusDouble()
    dpm = DpmClient(bus)  # type: ignore[arg-type]  # double
    for t_s in range(20):
        bus.t_s = t_s
        dpm.newest(math.inf, "mana", type="pose", child=str(t_s))
    bus.t_s = 0
    again = dpm.newest(math.inf, "mana", type="pose", child="0")
    assert again is not None
    assert again.header.t1_ns == 0
    assert bus.calls[-1].get("known") is None
