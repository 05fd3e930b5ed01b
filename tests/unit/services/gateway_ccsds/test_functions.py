# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Execution of commands with a client that records its calls."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cdff_common.client.answer import Answer
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.interfaces.product import Header
from services.gateway_ccsds.authentication import Command, Function
from services.gateway_ccsds.feed import Feed
from services.gateway_ccsds.functions import Functions
from services.gateway_ccsds.spool import Spool

ID = "7b0b7d3c-0000-5000-8000-000000000000"


class RecordingClient:
    """A client whose requests and retrievals return one product."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, dict[str, Any]]] = []
        self.robot = "mana"

    def request(
        self, product: str, *, on_progress: Callable[[dict[str, Any]], None], **options: Any
    ) -> Answer:
        self.calls.append((product, options))
        for state in ("planned", "running", "running", "delivering"):
            on_progress({"job": "job-1", "state": state, "reason": ""})
        return self._answer()

    def get(self, product_id: str, form: str | None = None) -> Answer:
        self.calls.append((product_id, {"form": form}))
        return self._answer()

    def cancel(self, job: str, robot: str) -> None:
        self.calls.append((job, {"robot": robot}))
        if job == "unknown":
            raise ProductNotFoundError("no job 'unknown'")

    def _answer(self) -> Answer:
        header = Header(
            id=ID, seq=1, t0_ns=10**9, t1_ns=10**9, frame="site", producer="mapping", config_hash="c"
        )
        encoding = "application/vnd.cdff+uper;Dem/1"
        return Answer(None, header, "Dem", b"content", encoding, self.robot, {"coverage": 0.9})


class Station:
    """Functions with a recording client and a spool."""

    def __init__(self, folder: Path) -> None:
        self.client, self.spool = RecordingClient(), Spool(folder / "spool", 1000)
        client: Any = self.client
        feed = Feed("mana", client, self.spool, (), folder / "position", 10**6, lambda _: None)
        self.reports: list[str] = []
        self._functions = Functions("mana", client, feed)

    def execute(self, function: Function, **arguments: Any) -> str:
        return self._functions.execute(Command(function, 1, arguments), self.reports.append)


@pytest.fixture
def station(tmp_path: Path) -> Station:
    return Station(tmp_path)


def test_a_requested_product_is_added_to_the_spool_with_what_was_delivered(station: Station) -> None:
    assert station.execute(Function.REQUEST, type="dem", region="bbox:-10,-5,10,5") == f"product {ID}"
    assert station.client.calls == [
        ("dem", {"robot": "mana", "deadline_s": 20.0, "region": "bbox:-10,-5,10,5"})
    ]
    payload, sidecar = station.spool.files()
    assert payload.read_bytes() == b"content"
    assert payload.name == f"mana-dem-1-{ID}.uper"
    stated = json.loads(sidecar.read_text())
    assert (stated["dfpc"], stated["delivered"]) == ("mapping", {"coverage": 0.9})


def test_the_options_of_a_request_have_the_names_of_the_wire_and_values_as_text_or_numbers(
    station: Station,
) -> None:
    as_text = {"priority": "9", "max_age_s": "60", "deadline_ms": "1500"}
    station.execute(Function.REQUEST, type="dem", t="5000", format="tif", robot="mana", **as_text)
    station.execute(
        Function.REQUEST, type="dem", **{"as": "ElevationMap"}, priority=9, max_age_s=60, deadline_ms=1500
    )
    shared = {"robot": "mana", "deadline_s": 1.5, "priority": 9, "max_age_s": 60.0}
    assert station.client.calls == [
        ("dem", {**shared, "t_ns": 5000, "format": "tif"}),
        ("dem", {**shared, "as_type": "ElevationMap"}),
    ]


def test_each_state_of_the_job_of_a_request_is_reported_once(station: Station) -> None:
    station.execute(Function.REQUEST, type="dem")
    assert station.reports == ["job job-1: planned", "job job-1: running", "job job-1: delivering"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "'type' is missing"),
        ({"type": 5}, "type"),
        ({"type": None}, "type"),
        ({"type": "dem", "deadline_ms": "abc"}, "deadline_ms='abc': expected a number"),
        ({"type": "dem", "deadline_ms": None}, "deadline_ms"),
        ({"type": "dem", "deadline_ms": [1]}, "deadline_ms"),
        ({"type": "dem", "deadline_ms": float("nan")}, "deadline_ms=nan: expected a finite number"),
        ({"type": "dem", "deadline_ms": 3e6}, "deadline_ms"),
        ({"type": "dem", "deadline_ms": -1}, "deadline_ms"),
        ({"type": "dem", "region": [0, 1]}, "region"),
        ({"type": "dem", "priority": True}, "priority"),
        ({"type": "dem", "format": {}}, "format"),
        ({"type": "dem", "robot": "minnie"}, "robot='minnie'"),
        ({"type": "dem", "robot": 1}, "robot=1"),
        ({"type": "dem", "on_progress": "x"}, "unknown parameter 'on_progress'"),
        ({"type": "dem", "deadline_s": 1}, "unknown parameter 'deadline_s'"),
        ({"type": "dem", "every_s": 1}, "'every_s': not available in a command"),
        ({"type": "dem", "deliver": "none"}, "'deliver': not available in a command"),
    ],
)
def test_a_request_with_wrong_arguments_is_refused_and_not_sent(
    station: Station, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        station.execute(Function.REQUEST, **arguments)
    assert station.client.calls == []


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"id": 5},
        {"id": "../../x"},
        {"id": ID, "format": 5},
        {"id": ID, "format": "../x"},
        {"id": ID, "colour": "red"},
    ],
)
def test_a_transfer_with_wrong_arguments_is_refused(station: Station, arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        station.execute(Function.SEND, **arguments)
    assert station.client.calls == []


def test_a_stored_product_of_this_robot_only_is_sent_in_the_given_format(station: Station) -> None:
    assert station.execute(Function.SEND, id=ID, format="tif") == f"product {ID}"
    assert station.client.calls == [(ID, {"form": "tif"})]
    assert station.spool.files()[0].suffix == ".tif"
    station.client.robot = "minnie"
    with pytest.raises(ProductNotFoundError, match="it is of minnie"):
        station.execute(Function.SEND, id=ID)


def test_a_job_of_this_robot_is_cancelled_and_an_unknown_one_is_an_error(station: Station) -> None:
    assert station.execute(Function.CANCEL, job="job-1") == "job job-1"
    assert station.client.calls == [("job-1", {"robot": "mana"})]
    with pytest.raises(ProductNotFoundError, match="unknown"):
        station.execute(Function.CANCEL, job="unknown")


@pytest.mark.parametrize("arguments", [{}, {"job": 5}, {"job": "a", "robot": "any"}, {"job": "a", "id": ID}])
def test_a_cancellation_with_wrong_arguments_is_refused(station: Station, arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        station.execute(Function.CANCEL, **arguments)
    assert station.client.calls == []
