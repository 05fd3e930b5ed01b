# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writers of products until the process or its server ends.

    python -m evaluation.runs.durability_load store|postgresql PLACE SEED FIRST

PLACE is the data folder of the store, or the connection string of PostgreSQL. Each operation is a line of
JSON on standard output before its start and one after its acknowledgement. Products are numbered from FIRST;
their contents depend only on their number.
"""

from __future__ import annotations

import itertools
import json
import os
import random
import sys
import threading
from typing import Any, Protocol

from cdff_common.errors import ProductNotFoundError
from cdff_common.interfaces.product import Header, product_id
from dpm_store import NewProduct, Store, open_store

S = 1_000_000_000
WRITERS = 2
#: Words of 4 bytes in a payload, by the number of the product: 200 bytes, 12 kB and 40 kB.
_WORDS = (10_000, 3_000, 50, 50, 50)


class Products(Protocol):
    """Store of products under test."""

    def put_all(self, products: list[NewProduct]) -> None:
        """Insert products in one transaction."""

    def delete(self, product: str) -> None:
        """Delete a product."""

    def payload(self, product: str) -> bytes | None:
        """Return the payload; None if the product is missing or deleted."""

    def close(self) -> None:
        """Close the store or the connection."""


class StoreProducts:
    """The store of the DPM as ``Products``."""

    def __init__(self, folder: str) -> None:
        self._store: Store = open_store(f"sqlite:///{folder}")

    def put_all(self, products: list[NewProduct]) -> None:
        """Insert products in one transaction."""
        self._store.put_all(products)

    def delete(self, product: str) -> None:
        """Delete a product."""
        self._store.delete(product)

    def payload(self, product: str) -> bytes | None:
        """Return the payload; None if the product is missing or deleted."""
        try:
            return self._store.payload(product)
        except ProductNotFoundError:
            return None

    def close(self) -> None:
        """Close the store."""
        self._store.close()


def payload(seq: int) -> bytes:
    """Return the payload of a product."""
    return seq.to_bytes(4, "big") * _WORDS[seq % len(_WORDS)]


def product(seq: int) -> NewProduct:
    """Return the product with a number."""
    t_ns = seq * S
    header = Header(
        product_id("mana", "load", "dem", t_ns, seq, "c"),
        seq,
        t_ns,
        t_ns,
        "site",
        "load/1",
        config_hash="c",
        box_m=(float(seq), 0.0, 0.0, seq + 0.5, 1.0, 1.0),
    )
    return NewProduct(header, payload(seq), "mana", "load", "dem", "dem", "ElevationMap")


def report(what: str, seqs: list[int]) -> None:
    """Write one line with a single system call."""
    os.write(1, (json.dumps({"what": what, "seqs": seqs}) + "\n").encode())


def write(products: Products, seed: int, seqs: itertools.count[int]) -> None:
    """Insert products singly and in batches, and delete some, until the store fails."""
    rng = random.Random(seed)
    stored_seqs: list[int] = []
    while True:
        if len(stored_seqs) > 10 and rng.random() < 0.2:
            chosen = [stored_seqs.pop(rng.randrange(len(stored_seqs)))]
            report("delete", chosen)
            products.delete(product(chosen[0]).header.id)
            report("deleted", chosen)
            continue
        chosen = [next(seqs) for _ in range(rng.choice((1, 1, 1, 8)))]
        report("put", chosen)
        products.put_all([product(seq) for seq in chosen])
        report("stored", chosen)
        stored_seqs += chosen


def open_products(kind: str, place: str) -> Products:
    """Open the store of the DPM, or a connection to PostgreSQL."""
    if kind == "store":
        return StoreProducts(place)
    from evaluation.peers.postgresql import PostgresProducts

    return PostgresProducts(place)


def main() -> None:
    """Run the writers until the process is killed or the server has ended."""
    kind, place, seed, first = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    seqs = itertools.count(first)
    shared = open_products(kind, place) if kind == "store" else None

    def run(number: int) -> None:
        try:
            write(shared or open_products(kind, place), seed * WRITERS + number, seqs)
        except Exception as error:  # noqa: BLE001  # the server has ended
            report(f"ended by {type(error).__name__}", [])

    threads: list[Any] = [threading.Thread(target=run, args=(number,)) for number in range(WRITERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


if __name__ == "__main__":
    main()
