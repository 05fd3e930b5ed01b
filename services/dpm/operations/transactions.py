# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parsing of a transaction's changes, and their outcomes in JSON form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from pydantic import FailFast, Field, TypeAdapter

from cdff_common.contract.parameters import Parameters, Revision
from cdff_common.errors import InputError
from dpm_store import Annotation, FrameRevision, NewProduct
from dpm_store.products import transaction
from dpm_store.products.transaction import Change, Outcome
from services.dpm.queries.bodies import FrameEdge, ProductBody, validated

CheckedProduct = Callable[[Mapping[str, str], bytes, str, bytes], NewProduct]


class Insert(ProductBody):
    """Insertion of a product."""

    do: Literal["insert"]


class Reanchor(FrameEdge):
    """A frame revision."""

    do: Literal["reanchor"]
    frame: str


class OfProduct(Parameters):
    """A change of the product ``id``, if its annotation is at revision ``if_match``."""

    id: str
    if_match: Revision | None = None


class DeleteOrPin(OfProduct):
    """Deletion of a product, or change of its pin."""

    do: Literal["delete", "pin", "unpin"]


class Update(OfProduct):
    """A change of an annotation."""

    do: Literal["update"]
    changes: dict[str, Any]


class Supersede(OfProduct):
    """Statement of the successor of a product."""

    do: Literal["supersede"]
    by: str


_Change = Annotated[Insert | Reanchor | DeleteOrPin | Update | Supersede, Field(discriminator="do")]
_CHANGES = TypeAdapter(Annotated[list[_Change], FailFast(), Field(min_length=1)])


def parse_changes(body: Any, checked_product: CheckedProduct, author: str) -> list[Change]:
    """Return the changes of a list of maps, each with ``do`` and the fields of its model.

    Parameters
    ----------
    checked_product : callable
        ``StoreWriter.checked_product``.
    author : str
        Author of the revisions.

    Raises
    ------
    InputError
        If a change is malformed; the message states its index.
    """
    changes: list[Change] = []
    items = validated(_CHANGES, body, "transaction")
    for index, item in enumerate(items):
        try:
            changes.append(_change(item, checked_product, author))
        except InputError as error:
            raise InputError(f"transaction, change {index} ({item.do}): {error}") from error
    return changes


def outcome_dict(outcome: Outcome) -> dict[str, Any]:
    """Return the outcome of a change in JSON form."""
    if isinstance(outcome, Annotation):
        return {"id": outcome.product_id, **outcome.to_dict()}
    if isinstance(outcome, FrameRevision):
        return outcome.to_dict()
    return {"deleted": outcome} if isinstance(outcome, bool) else {"result": str(outcome)}


def _change(item: _Change, checked_product: CheckedProduct, author: str) -> Change:
    match item:
        case Insert():
            return checked_product(*item.parts)
        case Reanchor():
            options = item.options() | {"producer": author}
            return transaction.Reanchor(item.frame, item.parent, item.transform(), options)
        case Update():
            changes = item.changes
        case Supersede():
            changes = {"superseded_by": item.by}
        case DeleteOrPin(do="delete"):
            return transaction.Delete(item.id, item.if_match)
        case DeleteOrPin():
            changes = {"pinned": item.do == "pin"}
    return transaction.Update(item.id, changes, item.if_match, author)
