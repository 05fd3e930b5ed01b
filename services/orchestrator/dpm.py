# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator's view of the DPM: search, values by id, elevation windows, poses, derived products."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string, parse_encoding
from cdff_common.codecs.siblings import wire_type
from cdff_common.errors import DeadlineError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from services.orchestrator.timing import REAL, Timing

#: Decoded values kept by id: products never change.
_CACHED = 16
#: Longest a single call may take, seconds.
_CALL_S = 5.0
#: ``dfpc`` of what the orchestrator derives and stores; it is never taken as a source again.
DERIVED_DFPC = "orchestrator"


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """A product of the DPM: header, where it comes from, its value, and the bytes it came as."""

    header: Header
    robot: str
    value: Any
    type_name: str
    manifest: Mapping[str, Any]
    payload: bytes = b""
    encoding: str = ""


class Dpm:
    """Calls of ``dpm/@rpc/…`` under the scope ``ground``: answers do not depend on the scope (contract §5).

    Every method takes the time until which it may last (``until_s``, monotonic seconds) and raises what the DPM
    answers, UnavailableError where it is away, DeadlineError where no time is left.
    """

    def __init__(self, bus: Bus, timing: Timing = REAL) -> None:
        self._bus = bus
        self._timing = timing
        self._lock = timing.lock()
        self._values: OrderedDict[str, Stored] = OrderedDict()

    def _left(self, until_s: float) -> float:
        """Seconds a call may last."""
        left_s = until_s - self._timing.now_s()
        if left_s <= 0.0:
            raise DeadlineError("no time left to ask the DPM")
        return min(left_s, _CALL_S)

    def search(self, until_s: float, **parameters: object) -> list[dict[str, Any]]:
        """Metadata of products, newest end of capture first."""
        asked = {k: v for k, v in parameters.items() if v is not None}
        body = self._bus.call(keys.dpm_rpc(keys.GROUND, "search"), asked, timeout_s=self._left(until_s)).body()
        items = body.get("items") if isinstance(body, dict) else None
        if not isinstance(items, list):
            raise InputError(f"the DPM answered a search with {str(body)[:80]!r}, expected items")
        return items

    def value(self, product_id: str, robot: str, until_s: float) -> Stored:
        """A product by id."""
        with self._lock:
            if product_id in self._values:
                self._values.move_to_end(product_id)
                return self._values[product_id]
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), {"id": product_id}, timeout_s=self._left(until_s))
        stored = _stored(reply.payload, reply.encoding, reply.attachment, robot)
        with self._lock:
            self._values[product_id] = stored
            while len(self._values) > _CACHED:
                self._values.popitem(last=False)
        return stored

    def window(self, until_s: float, **parameters: object) -> Stored:
        """The elevation of a region, pooled from every patch that reaches into it."""
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), _window(parameters), timeout_s=self._left(until_s))
        return _stored(reply.payload, reply.encoding, reply.attachment, str(parameters.get("robot") or keys.GROUND))

    def stored_window(self, until_s: float, **parameters: object) -> Mapping[str, Any]:
        """Have the DPM keep such a window; its metadata, ``id`` among them."""
        asked = {**_window(parameters), "deliver": "reference"}
        return self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=self._left(until_s)).attachment

    def pose(self, robot: str, parent: str, child: str, t_ns: int | None, until_s: float) -> UncertainTransform:
        """``T_parent_child`` at a time (the newest without one), interpolated and composed over the frame tree."""
        if parent == child:
            return UncertainTransform.identity()
        asked: dict[str, object] = {"robot": robot, "parent": parent, "child": child}
        if t_ns is not None:
            asked["t"] = t_ns
        body = self._bus.call(keys.dpm_rpc(keys.GROUND, "pose"), asked, timeout_s=self._left(until_s)).body()
        return UncertainTransform(body["T"], body.get("covariance"))

    def put(self, header: Header, value: Any, type_name: str, robot: str, product: str, until_s: float) -> None:
        """Store what the orchestrator derived, so that it can be fetched by id."""
        asked = {"robot": robot, "dfpc": DERIVED_DFPC, "port": product, "product": product}
        self._bus.call(
            keys.dpm_rpc(keys.GROUND, "put"),
            asked,
            payload=encode(value, "uper"),
            attachment=header.to_attachment(),
            encoding=encoding_string(wire_type(value), "uper"),
            timeout_s=self._left(until_s),
        )


def _window(parameters: Mapping[str, object]) -> dict[str, object]:
    return {"type": "dem", **{k: v for k, v in parameters.items() if v is not None}}


def _stored(payload: bytes, encoding: str, attachment: Mapping[str, Any], robot: str) -> Stored:
    header = Header.from_dict(attachment)
    type_name, codec = parse_encoding(encoding)
    owner = str(attachment.get("robot") or robot)
    return Stored(header, owner, decode(type_name, payload, codec), type_name, attachment, payload, encoding)
