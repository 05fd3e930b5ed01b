# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator's view of the DPM: search, values by id, elevation windows, poses, derived products."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string, parse_encoding
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header

#: Decoded values kept by id: products never change.
_CACHED = 16
#: ``dfpc`` of what the orchestrator derives and stores; it is never taken as a source again.
DERIVED_DFPC = "orchestrator"


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """A product of the DPM: header, where it comes from, and its value."""

    header: Header
    robot: str
    value: Any
    type_name: str
    manifest: Mapping[str, Any]


class Dpm:
    """Calls of ``dpm/@rpc/…`` under the scope ``ground``: answers do not depend on the scope (contract §5).

    Every method takes the seconds it may last and raises what the DPM answers, UnavailableError where it is away.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._lock = threading.Lock()
        self._values: OrderedDict[str, Stored] = OrderedDict()

    def search(self, timeout_s: float, **parameters: object) -> list[dict[str, Any]]:
        """Metadata of products, newest end of capture first."""
        asked = {k: v for k, v in parameters.items() if v is not None}
        body = self._bus.call(keys.dpm_rpc(keys.GROUND, "search"), asked, timeout_s=timeout_s).body()
        items = body.get("items") if isinstance(body, dict) else None
        if not isinstance(items, list):
            raise InputError(f"the DPM answered a search with {str(body)[:80]!r}, expected items")
        return items

    def value(self, product_id: str, robot: str, timeout_s: float) -> Stored:
        """A product by id."""
        with self._lock:
            if product_id in self._values:
                self._values.move_to_end(product_id)
                return self._values[product_id]
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), {"id": product_id}, timeout_s=timeout_s)
        stored = _stored(reply.payload, reply.encoding, reply.attachment, robot)
        with self._lock:
            self._values[product_id] = stored
            while len(self._values) > _CACHED:
                self._values.popitem(last=False)
        return stored

    def window(self, timeout_s: float, **parameters: object) -> Stored:
        """The elevation of a region, pooled from every patch that reaches into it."""
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), _window(parameters), timeout_s=timeout_s)
        return _stored(reply.payload, reply.encoding, reply.attachment, str(parameters.get("robot") or keys.GROUND))

    def stored_window(self, timeout_s: float, **parameters: object) -> Mapping[str, Any]:
        """Have the DPM keep such a window; its metadata, ``id`` among them."""
        asked = {**_window(parameters), "deliver": "reference"}
        return self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=timeout_s).attachment

    def pose(self, robot: str, parent: str, child: str, t_ns: int | None, timeout_s: float) -> UncertainTransform:
        """``T_parent_child`` at a time (the newest without one), interpolated and composed over the frame tree."""
        if parent == child:
            return UncertainTransform.identity()
        asked: dict[str, object] = {"robot": robot, "parent": parent, "child": child}
        if t_ns is not None:
            asked["t"] = t_ns
        body = self._bus.call(keys.dpm_rpc(keys.GROUND, "pose"), asked, timeout_s=timeout_s).body()
        return UncertainTransform(body["T"], body.get("covariance"))

    def put(self, header: Header, value: Any, type_name: str, robot: str, product: str, timeout_s: float) -> None:
        """Store what the orchestrator derived, so that it can be fetched by id."""
        asked = {"robot": robot, "dfpc": DERIVED_DFPC, "port": product, "product": product}
        self._bus.call(
            keys.dpm_rpc(keys.GROUND, "put"),
            asked,
            payload=encode(value, "uper"),
            attachment=header.to_attachment(),
            encoding=encoding_string(type_name, "uper"),
            timeout_s=timeout_s,
        )


def _window(parameters: Mapping[str, object]) -> dict[str, object]:
    return {"type": "dem", **{k: v for k, v in parameters.items() if v is not None}}


def _stored(payload: bytes, encoding: str, attachment: Mapping[str, Any], robot: str) -> Stored:
    header = Header.from_dict(attachment)
    type_name, codec = parse_encoding(encoding)
    owner = str(attachment.get("robot") or robot)
    return Stored(header, owner, decode(type_name, payload, codec), type_name, attachment)
