# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests for robots that are out of contact: kept, sent in a window, answered, or expired with a reason."""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping
from typing import Any

from cdff_common.clock import format_stamp
from cdff_common.contract.queries import RequestParameters
from cdff_common.errors import CdffError, InputError, ProductNotFoundError
from cdff_common.interfaces.contact_plan import ContactPlan
from dpm_store.exchange.ledger import Ledger, RequestRow
from services.contact.packets import CHUNK_BYTES
from services.dpm.operations.dpm import Dpm

#: Time until a request expires, by default and at most, seconds.
DEFAULT_EXPIRY_S, MAX_EXPIRY_S = 86_400.0, 30 * 86_400.0
#: Requests that are sent at once, because the uplink of a robot is slow, and those that are looked at.
_AT_ONCE, _CHOICE = 10, 100
#: Time for which ended requests are kept, and changes of the ground, seconds; period of their removal.
KEPT_S, KEPT_CHANGE_S, PRUNE_S = 60 * 86_400.0, 86_400.0, 600.0
#: States of requests that are not answered.
OPEN = ("kept", "accepted", "executed")


def prune(ledger: Ledger, now_ns: int) -> None:
    """Remove the requests that ended long ago; the other side has noted their end, or they have expired."""
    ledger.remove_ended_requests(now_ns - int(KEPT_S * 1e9), now_ns - int(KEPT_CHANGE_S * 1e9), OPEN)


class DeferredRequests:
    """The requests of the ground, in the ledger."""

    def __init__(self, dpm: Dpm, ledger: Ledger, plan: ContactPlan) -> None:
        self._dpm, self._ledger, self._plan = dpm, ledger, plan
        self._prune_ns = 0

    def add(
        self,
        robot: str,
        parameters: Mapping[str, str],
        expires_s: float = DEFAULT_EXPIRY_S,
        request_id: str | None = None,
    ) -> dict[str, Any]:
        """Keep a request and return it; the same id again returns the kept request.

        Raises
        ------
        InputError
            For parameters that the orchestrator would refuse, a robot without windows, or a bad expiry.
        """
        if not any(window.robot == robot for window in self._plan.windows):
            known = ", ".join(sorted({window.robot for window in self._plan.windows}))
            raise InputError(f"robot={robot[:64]!r}: the contact plan has windows of {known}")
        if not 0 < expires_s <= MAX_EXPIRY_S:
            raise InputError(f"expires_s={expires_s:g}: expected more than 0 and at most {MAX_EXPIRY_S:g}")
        body = {str(k): str(v) for k, v in parameters.items()}
        RequestParameters.parse({k: v for k, v in body.items() if k != "robot"})
        if (size := sum(len(k) + len(v) for k, v in body.items())) > CHUNK_BYTES // 2:
            raise InputError(f"request of {size} bytes: expected at most {CHUNK_BYTES // 2}")
        now_ns = self._dpm.clock.now_ns()
        request_id = request_id or str(uuid.uuid4())
        expires_ns = now_ns + int(expires_s * 1e6) * 1000
        self._ledger.add_request(RequestRow(request_id, robot, "kept", now_ns, expires_ns, body, None))
        return self.get(request_id)

    def add_change(self, robot: str, request_id: str, body: dict[str, str]) -> None:
        """Keep a change of an annotation, or deletions, for a robot; see ``services.contact.changes``."""
        now_ns = self._dpm.clock.now_ns()
        expires_ns = now_ns + int(MAX_EXPIRY_S) * 1_000_000_000
        self._ledger.add_request(RequestRow(request_id, robot, "kept", now_ns, expires_ns, body, None))

    def get(self, request_id: str) -> dict[str, Any]:
        """Return a request; raises ProductNotFoundError for an unknown id."""
        row = self._ledger.request(request_id)
        if row is None:
            raise ProductNotFoundError(f"no request {request_id[:64]!r}")
        return describe(row)

    def everything(self) -> list[dict[str, Any]]:
        """Return all requests, the oldest first."""
        return [describe(row) for row in self._ledger.requests()]

    def open(self, robot: str) -> list[RequestRow]:
        """Return the oldest requests that the robot has not accepted, as many as are sent at once.

        Of several changes of a field of an annotation only the oldest is sent, because packets can arrive in
        another order.
        """
        rows: list[RequestRow] = []
        fields = set()
        for row in self._ledger.requests("kept", robot=robot, limit=_CHOICE):
            field = _changed_field(row.body)
            if field is None or field not in fields:
                rows.append(row)
                fields.add(field)
        return rows[:_AT_ONCE]

    def taken(self, request_id: str) -> None:
        """Note that the robot has accepted a request."""
        if self._state(request_id) == "kept":
            self._ledger.set_request(request_id, "accepted")

    def result(self, request_id: str, result: dict[str, Any]) -> None:
        """Note the answer of the robot; the product of the answer may still be on its way."""
        if self._state(request_id) in ("kept", "accepted"):
            self._ledger.set_request(request_id, "failed" if "error" in result else "executed", result)

    def update(self) -> None:
        """End the requests whose product has arrived, and those whose time is over."""
        now_ns = self._dpm.clock.now_ns()
        for row in self._ledger.requests("executed"):
            product_id = (row.result or {}).get("id")
            if not product_id or self._dpm.store.live([product_id]):
                self._ledger.set_request(row.id, "answered", row.result)
        for row in self._ledger.requests(*OPEN, expired_ns=now_ns):
            self._ledger.set_request(row.id, "expired", {"error": self._reason(row)})
        if now_ns >= self._prune_ns:
            self._prune_ns = now_ns + int(PRUNE_S * 1e9)
            prune(self._ledger, now_ns)

    def _reason(self, row: RequestRow) -> str:
        end = format_stamp(row.expires_ns)
        if row.state == "accepted":
            return f"{row.robot} accepted the request, and no answer came before {end}"
        if row.state == "executed":
            return f"product {(row.result or {}).get('id')} did not arrive before {end}; it comes later"
        windows = [w for w in self._plan.after(row.robot, row.made_ns) if w.start_ns < row.expires_ns]
        if windows:
            return (
                f"{row.robot} was not in contact before {end}, although the plan has {len(windows)} windows"
            )
        return f"the contact plan has no window of {row.robot} before {end}"

    def _state(self, request_id: str) -> str:
        try:
            return str(self.get(request_id)["state"])
        except CdffError:
            return ""


def _changed_field(body: dict[str, Any]) -> tuple[str, ...] | None:
    """Return product and field that a request changes; None if it is no change of an annotation."""
    return (body["id"], *json.loads(body["values"])) if body.get("change") == "update" else None


def describe(row: RequestRow) -> dict[str, Any]:
    """Return a request as plain data."""
    return {
        "id": row.id,
        "robot": row.robot,
        "state": row.state,
        "made_ns": row.made_ns,
        "expires_ns": row.expires_ns,
        "parameters": row.body,
        "result": row.result,
    }
