# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check of the signatures of all products in a store."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from cdff_common.codecs import encoding_string
from dpm_store import ProductRecord, Query, Store
from dpm_store.history.maintenance import Problem
from services.signatures import SignatureVerifier

#: Number of products that are read from the store at once.
_PAGE = 1000


def signature_problems(store: Store, authority: Path) -> tuple[int, tuple[Problem, ...]]:
    """Return the number of signed products, and those whose signature is not valid.

    Payloads are compared with the digests in the headers by ``Store.verify``.
    """
    verifier = SignatureVerifier(authority)
    signed, problems = 0, []
    for record in _records(store):
        if record.header.signature is None:
            continue
        signed += 1
        encoding = encoding_string(record.type_name, record.codec)
        problem = verifier.problem(record.names, encoding, record.header)
        if problem:
            problems.append(Problem(f"product {record.id}", problem))
    return signed, tuple(problems)


def _records(store: Store) -> Iterator[ProductRecord]:
    cursor = None
    while True:
        page = store.search(Query(limit=_PAGE, cursor=cursor))
        yield from page.items
        cursor = page.cursor
        if cursor is None:
            return
