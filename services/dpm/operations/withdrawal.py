# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Withdrawal of bad maps: of single patches, or of all maps of a robot in a time, and of their results.

Withdrawn products are deleted in one transaction. Their metadata and provenance stay, and states of the store
before the withdrawal (``as_of``) show them until retention collects the payloads of deleted products.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from cdff_common.contract.limits import MAX_PAGE
from cdff_common.contract.names import GROUND
from cdff_common.contract.products import product_type
from cdff_common.contract.queries import WithdrawalParameters
from cdff_common.errors import InputError, ProductNotFoundError
from dpm_store import ProductRecord, Query, Store
from dpm_store.history.events import check_robot
from dpm_store.products.products import MAX_BATCH
from dpm_store.products.transaction import Delete
from services.dpm.operations.event_publisher import EventPublisher

#: Largest number of ids in the entry of the history, which has a limited size; each product also has an
#: entry of its own.
_IDS_IN_ENTRY = 500


class Withdrawal:
    """Withdrawal of products from all maps of a store."""

    def __init__(self, store: Store, events: EventPublisher) -> None:
        self._store = store
        self._events = events

    def run(self, parameters: WithdrawalParameters) -> dict[str, Any]:
        """Delete the selected products and the maps that were made from them, all or none.

        Returns
        -------
        dict
            ``withdrawn`` and ``derived``: ids; ``robots``; ``applied``: False with ``dry_run``.

        Raises
        ------
        ProductNotFoundError
            If nothing is selected.
        ConflictError
            If a product is pinned.
        InputError
            If a product of ``id`` is not of ``type``, or there are more than ``MAX_BATCH`` products.
        DeniedError
            If the actor is a robot and a product, or one that was made from it, is not its own.
        """
        selected = self._selected(parameters)
        if not selected:
            raise ProductNotFoundError("no product is selected by that robot, time, dfpc and type")
        derived = self._derived(selected, parameters.type)
        records = [*selected.values(), *derived.values()]
        if len(records) > MAX_BATCH:
            raise InputError(
                f"{len(records)} products: expected at most {MAX_BATCH} in one call; give t0 and t1"
            )
        for record in records:
            check_robot(record.robot)
        robots = sorted({record.robot for record in selected.values()})
        result = {
            "withdrawn": list(selected),
            "derived": list(derived),
            "robots": robots,
            "applied": not parameters.dry_run,
        }
        if parameters.dry_run:
            return result
        entry = {
            "reason": parameters.reason,
            "robots": robots,
            "products": len(selected),
            "derived": len(derived),
            "ids": list(selected)[:_IDS_IN_ENTRY],
            "selection": parameters.to_parameters(),
        }
        scope = robots[0] if len(robots) == 1 else GROUND
        self._store.transact([Delete(record.id) for record in records], (scope, "withdrawn", entry))
        for _ in records:
            self._events.count("deleted")
        self._events.publish()
        return result

    def _selected(self, parameters: WithdrawalParameters) -> dict[str, ProductRecord]:
        for name in parameters.type:
            product_type(name)
        if parameters.id:
            by_id = {i: self._store.get(i) for i in parameters.id}
            for record in by_id.values():
                if record.product not in parameters.type:
                    raise InputError(
                        f"product {record.id} is of type {record.product}, expected "
                        f"{' or '.join(parameters.type)}; give its type"
                    )
            return by_id
        query = Query(
            types=parameters.type,
            robot=parameters.robot,
            dfpc=parameters.dfpc,
            t0_ns=parameters.t0,
            t1_ns=parameters.t1,
            limit=MAX_PAGE,
        )
        record_by_id: dict[str, ProductRecord] = {}
        while True:
            page = self._store.search(query)
            record_by_id |= {record.id: record for record in page.items}
            if page.cursor is None:
                return record_by_id
            if len(record_by_id) > MAX_BATCH:
                raise InputError(
                    f"more than {MAX_BATCH} products: expected fewer in one call; give t0 and t1"
                )
            query = replace(query, cursor=page.cursor)

    def _derived(self, selected: dict[str, ProductRecord], types: Iterable[str]) -> dict[str, ProductRecord]:
        """Return the live products of these types that were made from the selected ones."""
        withdrawn_types = set(types)
        record_by_id: dict[str, ProductRecord] = {}
        for product_id in selected:
            lineage = self._store.lineage(product_id, "down")
            if lineage.truncated:
                raise InputError(f"product {product_id}: too many products were made from it for one call")
            record_by_id |= lineage.records
        ids = [i for i, r in record_by_id.items() if r.product in withdrawn_types and i not in selected]
        return {i: record_by_id[i] for i in self._store.live(ids)}
