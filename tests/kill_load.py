# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Everything that a store does, at once, until it is killed: ``python -m tests.kill_load DIR SEED FIRST``.

Each operation is told on standard output as one JSON line before it begins and one after it was acknowledged. Products
are numbered from FIRST on; what they hold follows from their number.
"""

from __future__ import annotations

import itertools
import json
import os
import random
import shutil
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from dpm_store import Parcel, Rule, Store, open_store
from dpm_store.backup import backup
from dpm_store.payloads import PACKED_BYTES

S = 1_000_000_000
#: Products of this type may go.
SCRATCH, KEPT = "image", "dem"
RULES = (Rule(SCRATCH, max_count=15),)
WRITERS = 2


def payload(seq: int) -> bytes:
    """Of a product: every fifth lies in a file, and every fifth takes some blocks of a pack."""
    words = PACKED_BYTES // 4 + 100 if seq % 5 == 0 else 3000 if seq % 5 == 1 else 50 + seq % 7
    return seq.to_bytes(4, "big") * words


def parcel(seq: int, product: str = KEPT) -> Parcel:
    """A product by its number."""
    header = Header(
        product_id("mana", "kill", product, seq * S, seq, "c"), seq, seq * S, seq * S, "site", "kill/1",
        config_hash="c", box_m=(float(seq), 0.0, 0.0, seq + 0.5, 1.0, 1.0), inputs=("sensor",),
    )  # fmt: skip
    return Parcel(header, payload(seq), "mana", "kill", product, product, "ElevationMap")


def tell(what: str, **fields: Any) -> None:
    """One line, in one write."""
    os.write(1, (json.dumps({"what": what, **fields}) + "\n").encode())


class Writer:
    """Inserts, batches, updates, deletes and re-anchors, in one thread."""

    def __init__(self, store: Store, seed: int, seqs: itertools.count[int], number: int) -> None:
        self._store = store
        self._rng = random.Random(seed * WRITERS + number)
        self._seqs = seqs
        self._number = number
        self._mine: list[int] = []

    def run(self) -> None:
        """Go on until the process ends."""
        while True:
            wanted = self._rng.choices(("put", "scratch", "batch", "tag", "delete", "frame"), (6, 3, 2, 4, 2, 1))[0]
            getattr(self, wanted)()

    def put(self) -> None:
        """Insert one product."""
        seq = next(self._seqs)
        tell("put", seqs=[seq])
        self._store.put_all([parcel(seq)])
        tell("put done", seqs=[seq])
        self._mine.append(seq)

    def scratch(self) -> None:
        """Insert one product that retention may take."""
        self._store.put_all([parcel(next(self._seqs), SCRATCH)])

    def batch(self) -> None:
        """Insert some products in one transaction."""
        seqs = [next(self._seqs) for _ in range(self._rng.randrange(2, 12))]
        tell("put", seqs=seqs)
        self._store.put_all([parcel(seq) for seq in seqs])
        tell("put done", seqs=seqs)
        self._mine += seqs

    def tag(self) -> None:
        """Say something new of a product."""
        if self._mine:
            seq = self._rng.choice(self._mine)
            product = parcel(seq).header.id
            revision = self._store.annotations.get(product).revision
            tags = [f"n{self._rng.randrange(1000)}"]
            tell("tag", seq=seq, revision=revision + 1, tags=tags)
            self._store.annotations.update(product, {"tags": tags}, if_match=revision)
            tell("tag done", seq=seq, revision=revision + 1, tags=tags)

    def delete(self) -> None:
        """Delete a product."""
        if self._mine:
            seq = self._mine.pop(self._rng.randrange(len(self._mine)))
            tell("delete", seq=seq)
            self._store.delete(parcel(seq).header.id)
            tell("delete done", seq=seq)
            if self._rng.random() < 0.3:
                self._store.purge(parcel(seq).header.id)

    def frame(self) -> None:
        """Re-anchor a frame of one's own."""
        name, x = f"kill/frame{self._number}", self._rng.random()
        T = UncertainTransform(se3.transform(np.eye(3), (x, 0.0, 0.0)))
        tell("frame", frame=name, x=x)
        revision = self._store.frames.set(name, "site", T)
        tell("frame done", frame=name, x=x, revision=revision.revision)


def look_after(store: Store, copies: Path) -> None:
    """Retention, collection and backups, one after the other, until the process ends."""
    for number in itertools.count():
        store.retention.apply(RULES)
        store.collect()
        target = copies / f"{os.getpid()}-{number}"
        backup(store.directory, target)
        tell("backup done", path=str(target))
        shutil.rmtree(copies / f"{os.getpid()}-{number - 1}", ignore_errors=True)


def main() -> None:
    """Work until killed."""
    directory, seed, first = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    with open_store(f"sqlite:///{directory / 'data'}") as store:
        seqs = itertools.count(first)
        for number in range(WRITERS):
            threading.Thread(target=Writer(store, seed, seqs, number).run, daemon=True).start()
        look_after(store, directory / "copies")


if __name__ == "__main__":
    main()
