# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Queries of a robot: only the documented parameters of a request pass to the client."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_common.errors import UnavailableError
from services.gateways.frames import FrameNames
from services.gateways.request_types import REQUEST_SERVICE, SERVICES
from services.gateways.requests import ProductRequests
from services.gateways.settings import RequestEntry
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType

_TYPES = RosTypes(1)
_SERVICE = ServiceType.register(_TYPES, REQUEST_SERVICE, SERVICES[REQUEST_SERVICE].definition)


class _Client:
    """The part of a client that requests products; it has none."""

    def __init__(self) -> None:
        self.requests: list[tuple[str, dict[str, Any]]] = []

    def request(self, product: str, **arguments: Any) -> Any:
        self.requests.append((product, arguments))
        raise UnavailableError("no product")


def _answer(query: str) -> tuple[Any, list[tuple[str, dict[str, Any]]]]:
    client: Any = _Client()
    entry = RequestEntry(name="/ask", type=REQUEST_SERVICE, products=("dem",))
    requests = ProductRequests(entry, _SERVICE.response, FrameNames("mana"), _TYPES, client)
    request = _TYPES.store.types[_SERVICE.request](query=query, deadline_s=0.0)
    return requests.answer(request), client.requests


@pytest.mark.parametrize(
    "name",
    [
        "deadline_s",
        "deadline_ms",
        "on_progress",
        "product",
        "robot",
        "self",
        "t_ns",
        "as_type",
        "format",
        "deliver",
        "explain",
        "every_s",
        "t0",
        "no_such",
    ],
)
def test_a_parameter_that_is_not_that_of_a_request_is_refused(name: str) -> None:
    answer, requests = _answer(f"type=dem;{name}=1")
    assert (answer.success, answer.code) == (False, "INVALID_ARGUMENT")
    assert answer.message.startswith(f"{name}: expected type and some of acquire, as, child,")
    assert not requests


def test_parameters_of_a_request_have_their_names_in_the_client() -> None:
    answer, requests = _answer("type=dem;region=circle:0,0,10;t=5;as=ElevationMap;max_age_s=60")
    assert answer.code == "UNAVAILABLE"
    ((product, arguments),) = requests
    assert product == "dem"
    expected = {"region": "circle:0,0,10", "t_ns": "5", "as_type": "ElevationMap", "max_age_s": "60"}
    assert {**arguments, **expected} == arguments
    assert (arguments["robot"], arguments["deadline_s"]) == ("mana", 20.0)
