# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Client of the DPM for the orchestrator: search, products by id, elevation windows, poses, insertion."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import Bus, Reply, keys
from cdff_common.codecs import decode_payload, encode_payload
from cdff_common.errors import DeadlineError, InputError, NoAnswerError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from services.orchestrator.timing import REAL, Timing

#: Number of cached decoded products; products are immutable.
CACHED = 16
#: Longest duration of a call, seconds.
_CALL_S = 5.0
#: ``dfpc`` of products derived by the orchestrator, which are never used as a source.
DERIVED_DFPC = "orchestrator"


@dataclass(frozen=True, slots=True, eq=False)
class StoredProduct:
    """A product of the DPM: header, robot, value, manifest and encoded payload."""

    header: Header
    robot: str
    value: Any
    manifest: Mapping[str, Any]
    payload: bytes
    encoding: str


class DpmClient:
    """Calls of ``dpm/@rpc/…``; replies do not depend on the scope.

    Every method takes its time limit (``until_s``, monotonic seconds) and raises the error of the DPM,
    UnavailableError if it is unreachable, or DeadlineError if no time is left.

    Parameters
    ----------
    without_dpm : callable, optional
        Returns the newest product of a type, and of a child frame, if the DPM is unreachable; None if there
        is none.
    scope : str
        Scope under which the identity of this process may call; default: ground.
    """

    def __init__(
        self,
        bus: Bus,
        timing: Timing = REAL,
        without_dpm: Callable[[str, str | None], StoredProduct | None] = lambda product, child: None,
        scope: str = keys.GROUND,
    ) -> None:
        self._bus, self._scope = bus, scope
        self._without_dpm = without_dpm
        self._timing = timing
        self._lock = timing.lock()
        self._values: OrderedDict[str, StoredProduct] = OrderedDict()
        #: Id of the newest product of searches.
        self._newest: dict[tuple[tuple[str, object], ...], str] = {}

    def _call(self, verb: str, parameters: Mapping[str, object], until_s: float, **more: Any) -> Reply:
        """Call a verb with the parameters that are not None."""
        remaining_s = until_s - self._timing.now_s()
        if remaining_s <= 0.0:
            raise DeadlineError("no time left to query the DPM")
        query = {k: v for k, v in parameters.items() if v is not None}
        timeout_s = min(remaining_s, _CALL_S)
        return self._bus.call(keys.dpm_rpc(self._scope, verb), query, timeout_s=timeout_s, **more)

    def search(self, until_s: float, **parameters: object) -> list[dict[str, Any]]:
        """Return metadata of products, newest end of capture first."""
        body = self._call("search", parameters, until_s).body()
        items = body.get("items") if isinstance(body, dict) else None
        if not isinstance(items, list):
            raise InputError(f"the DPM answered a search with {str(body)[:80]!r}, expected items")
        return items

    def value(self, product_id: str, robot: str, until_s: float) -> StoredProduct:
        """Return a product by id."""
        if (cached := self._cached(product_id)) is not None:
            return cached
        return self._kept(_stored(self._call("get", {"id": product_id}, until_s), robot))

    def newest(self, until_s: float, robot: str, **parameters: object) -> StoredProduct | None:
        """Return the newest product of a search that is not FAILED; None if there is none.

        It is one call, and the payload is not transferred again if it is the product of the previous call
        with these parameters.
        """
        query = {"robot": robot, **parameters}
        key = tuple(query.items())
        with self._lock:
            known = self._newest.get(key)
        cached = None if known is None else self._cached(known)
        try:
            reply = self._call("get", query | {"known": cached and known}, until_s)
        except ProductNotFoundError:
            return None
        except NoAnswerError:
            if {name for name, value in query.items() if value is not None} - {"robot", "type", "child"}:
                raise
            substitute = self._without_dpm(
                str(query["type"]), str(query["child"]) if "child" in query else None
            )
            if substitute is None:
                raise
            return substitute
        if cached is not None and reply.attachment.get("kind") == "reference":
            return cached
        stored = self._kept(_stored(reply, robot))
        with self._lock:
            self._newest[key] = stored.header.id
            while len(self._newest) > CACHED:
                del self._newest[next(iter(self._newest))]
        return stored

    def _cached(self, product_id: str) -> StoredProduct | None:
        with self._lock:
            if (stored := self._values.get(product_id)) is not None:
                self._values.move_to_end(product_id)
            return stored

    def _kept(self, stored: StoredProduct) -> StoredProduct:
        with self._lock:
            self._values[stored.header.id] = stored
            while len(self._values) > CACHED:
                self._values.popitem(last=False)
        return stored

    def window(self, until_s: float, **parameters: object) -> StoredProduct:
        """Return the elevation of a region, pooled from all its patches."""
        reply = self._call("get", {"type": "dem", **parameters}, until_s)
        return _stored(reply, str(parameters.get("robot") or keys.GROUND))

    def stored_window(self, until_s: float, **parameters: object) -> Mapping[str, Any]:
        """Store a window of elevation in the DPM; return its metadata with ``id``."""
        query = {"type": "dem", **parameters, "deliver": "reference"}
        return self._call("get", query, until_s).attachment

    def pose(
        self, robot: str, parent: str, child: str, t_ns: int | None, until_s: float
    ) -> UncertainTransform:
        """Return ``T_parent_child`` at a time, by default the newest, from the frame tree."""
        if parent == child:
            return UncertainTransform.identity()
        query = {"robot": robot, "parent": parent, "child": child, "t": t_ns}
        body = self._call("pose", query, until_s).body()
        return UncertainTransform(body["T"], body.get("covariance"))

    def put(self, header: Header, value: Any, robot: str, product: str, until_s: float) -> None:
        """Store a derived product, so that it can be retrieved by id."""
        payload, encoding = encode_payload(value)
        self._call(
            "put",
            {"robot": robot, "dfpc": DERIVED_DFPC, "port": product, "product": product},
            until_s,
            payload=payload,
            attachment=header.to_attachment(),
            encoding=encoding,
        )


def _stored(reply: Reply, robot: str) -> StoredProduct:
    return StoredProduct(
        header=Header.from_dict(reply.attachment),
        robot=str(reply.attachment.get("robot") or robot),
        value=decode_payload(reply.payload, reply.encoding),
        manifest=reply.attachment,
        payload=reply.payload,
        encoding=reply.encoding,
    )
