# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Changes of a transaction from plain data, and what they came to as plain data.

Each change is a map with ``do``: ``insert`` (the fields of a batch's product), ``update`` (``id``, ``if_match?``,
``changes``), ``delete`` (``id``, ``if_match?``), ``pin`` and ``unpin`` (``id``), ``supersede`` (``id``, ``by``),
``reanchor`` (a frame revision).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from cdff_common.errors import InputError
from dpm_store import Annotation, FrameRevision, Parcel
from dpm_store.records import LATEST_NS
from dpm_store.transaction import Change, Delete, Insert, Outcome, Reanchor, Update
from services.dpm.parameters import batch_of, check_names, transform_of

_FIELDS: dict[str, tuple[frozenset[str], frozenset[str]]] = {
    "insert": (
        frozenset({"robot", "dfpc", "port", "product", "encoding", "attachment", "payload"}),
        frozenset({"robot", "dfpc", "port", "product", "encoding", "attachment", "payload"}),
    ),
    "update": (frozenset({"id", "if_match", "changes"}), frozenset({"id", "changes"})),
    "delete": (frozenset({"id", "if_match"}), frozenset({"id"})),
    "pin": (frozenset({"id", "if_match"}), frozenset({"id"})),
    "unpin": (frozenset({"id", "if_match"}), frozenset({"id"})),
    "supersede": (frozenset({"id", "by", "if_match"}), frozenset({"id", "by"})),
    "reanchor": (
        frozenset({"frame", "parent", "T", "covariance", "valid_from_ns", "valid_until_ns", "expected_revision"}),
        frozenset({"frame", "parent", "T"}),
    ),
}  # fmt: skip

_REVISION = ("valid_from_ns", "valid_until_ns", "expected_revision")
ToParcel = Callable[[Mapping[str, str], bytes, str, bytes], Parcel]


def changes_of(body: Any, to_parcel: ToParcel, author: str) -> list[Change]:
    """Changes from a list of maps.

    Parameters
    ----------
    to_parcel : callable
        Checks a product and makes a parcel of it.
    author : str
        Who is entered as author of revisions.

    Raises
    ------
    InputError
        Naming the place of a change that cannot be read.
    """
    if not isinstance(body, (list, tuple)) or not body:
        raise InputError("transaction: expected a list of changes, one at least")
    return [_change(place, one, to_parcel, author) for place, one in enumerate(body)]


def told(outcome: Outcome) -> dict[str, Any]:
    """An outcome as plain data."""
    if isinstance(outcome, Annotation):
        return {"id": outcome.product_id, **outcome.to_dict()}
    if isinstance(outcome, FrameRevision):
        return outcome.to_dict()
    return {"deleted": outcome} if isinstance(outcome, bool) else {"result": str(outcome)}


def _change(place: int, one: Any, to_parcel: ToParcel, author: str) -> Change:
    where = f"transaction, change {place}"
    fields = dict(one) if isinstance(one, Mapping) else {}
    do = str(fields.pop("do", ""))
    if do not in _FIELDS:
        raise InputError(f"{where}: do={do[:40]!r}, expected one of {', '.join(_FIELDS)}")
    try:
        check_names(fields, *_FIELDS[do])
        if do == "insert":
            return Insert(to_parcel(*batch_of([fields])[0]))
        if do == "reanchor":
            options = {name: _integer(fields, name) for name in _REVISION}
            T = transform_of(fields)
            return Reanchor(str(fields["frame"]), str(fields["parent"]), T, options | {"producer": author})
        product_id, if_match = str(fields["id"]), _integer(fields, "if_match")
        if do == "delete":
            return Delete(product_id, if_match)
        if do == "update":
            if not isinstance(fields["changes"], Mapping):
                raise InputError("changes: expected a map")
            return Update(product_id, dict(fields["changes"]), if_match, author)
        said = {"superseded_by": str(fields["by"])} if do == "supersede" else {"pinned": do == "pin"}
        return Update(product_id, said, if_match, author)
    except InputError as error:
        raise InputError(f"{where} ({do}): {error}") from error


def _integer(fields: Mapping[str, Any], name: str) -> int | None:
    value = fields.get(name)
    if value is None:
        return None
    text = str(value)
    if isinstance(value, bool) or not re.fullmatch(r"-?\d{1,19}", text) or abs(int(text)) > LATEST_NS:
        raise InputError(f"{name}={text[:40]!r}: expected a whole number below 2^62")
    return int(text)
