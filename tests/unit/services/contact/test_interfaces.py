# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls of the exchange by the bus, the Python client and ``cdff dpm contact``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

from cdff_common.bus import Reply, Request
from cdff_common.client import Client
from cdff_common.errors import InputError
from cdff_common.interfaces.contact_plan import ContactPlan
from cdff_dev.contact.generated_products import product
from services.contact.ground_end import GroundEnd
from services.contact.service import answer
from services.dpm.cli.contact_commands import register
from tests.unit.services.contact.test_exchange import CLOUD, MAP, Ends, ends, is_at_ground, wait_until, window

__all__ = ["ends"]
SECOND_CLOUD = 2 * 22 - 1


class BusOfGround:
    """Bus double: passes each call to the exchange of the ground."""

    def __init__(self, ground: GroundEnd) -> None:
        self._ground = ground

    def call(self, key: str, parameters: dict[str, Any], payload: bytes = b"", **_: Any) -> Reply:
        assert key.endswith("/dpm/@rpc/contact")
        texts = {name: str(value) for name, value in parameters.items()}
        return Reply.of(answer(self._ground, Request(key, texts, payload, "", b"")))

    def close(self) -> None: ...


@pytest.fixture
def plan() -> ContactPlan:
    """A plan with an open window and a later window."""
    return ContactPlan(windows=(window(0, 100, 1e6), window(1000, 1100, delay_s=0.5)))


@pytest.fixture
def ground(ends: Ends, plan: ContactPlan, monkeypatch: pytest.MonkeyPatch) -> Iterator[GroundEnd]:
    """The exchange of the ground with the robot; both ends run in this process."""
    with ends.start_ground(plan) as end:
        monkeypatch.setattr("cdff_common.client.client.Bus.open", lambda *_, **__: BusOfGround(end))
        yield end


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run ``cdff dpm contact`` and return its output."""
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    args = parser.parse_args(["contact", *arguments])
    assert args.run(args) == 0
    return capsys.readouterr().out


def test_plan_and_status_are_returned_to_the_client_and_printed(
    ground: GroundEnd, plan: ContactPlan, capsys: pytest.CaptureFixture[str]
) -> None:
    with Client() as client:
        windows = client.contact("plan", robot="mana")["items"]
        assert [w["start_ns"] for w in windows] == [w.start_ns for w in plan.windows]
        assert [w["open"] for w in windows] == [True, False]
        assert client.contact("plan", robot="minnie")["items"] == []
        assert client.contact()["robots"]["mana"]["contact"] is False
    assert "4e+06 bit/s, delay 0.5 s" in run(capsys, "plan")
    assert "0 products (0 bytes)" in run(capsys, "status")
    assert json.loads(run(capsys, "status", "--json"))["robots"]["mana"]["backlog"] == []


def test_a_kept_request_is_returned_by_its_id(ground: GroundEnd, capsys: pytest.CaptureFixture[str]) -> None:
    with Client() as client:
        kept = client.request_after_contact("dem", "mana", expires_s=50.0, max_age_s=60.0)
        assert client.contact("requests", id=kept["id"])["state"] == "kept"
    assert kept["id"] in run(capsys, "requests")
    assert "mana, pose, kept" in run(capsys, "request", "mana", "pose", "frame=site")
    with pytest.raises(InputError, match="NAME=VALUE"):
        run(capsys, "request", "mana", "pose", "frame")


def test_a_product_that_the_ground_prioritises_arrives_before_older_ones(
    ends: Ends, ground: GroundEnd, plan: ContactPlan, capsys: pytest.CaptureFixture[str]
) -> None:
    numbers = (MAP, CLOUD, SECOND_CLOUD)
    ends.robot.store.put_all([product(1, n) for n in numbers])
    with ends.start_robot(plan, budget_bit_s=1e6):
        with Client() as client:

            def is_named() -> bool:
                with suppress(InputError):
                    return bool(client.contact(robot="mana", first=product(1, SECOND_CLOUD).header.id))
                return False

            wait_until(is_named)
            items = client.contact("estimate", robot="mana")["items"]
        assert [item["priority"] for item in items] == [0, 2]
        assert product(1, SECOND_CLOUD).header.id in run(capsys, "estimate", "mana").splitlines()[0]
        wait_until(lambda: is_at_ground(ends, SECOND_CLOUD))
        assert not is_at_ground(ends, CLOUD)


def test_a_product_that_is_not_on_its_way_cannot_be_prioritised(ground: GroundEnd) -> None:
    with Client() as client:
        with pytest.raises(InputError, match="no product of mana"):
            client.contact(robot="mana", first="unknown")
        with pytest.raises(InputError, match="robot is missing"):
            client.contact(first="unknown")
