# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mixed operations on a store until the process is killed: ``python -m tests.kill_load DIR SEED FIRST``.

Each operation is reported on standard output as one JSON line before its start and one after its
acknowledgement. Products are numbered from FIRST; their contents depend only on their number.
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
from dpm_store import NewProduct, Rule, Store, open_store
from dpm_store.history.backup import backup
from dpm_store.payloads.payloads import PACKED_BYTES

S = 1_000_000_000
#: Type of the products that retention may delete, and type of the others.
SCRATCH, KEPT = "image", "dem"
RULES = (Rule(product=SCRATCH, max_count=15),)
WRITERS = 2


def payload(seq: int) -> bytes:
    """Return a payload: of five, one is stored in a file, one in several blocks of a pack, three in one."""
    repetitions = PACKED_BYTES // 4 + 100 if seq % 5 == 0 else 3000 if seq % 5 == 1 else 50 + seq % 7
    return seq.to_bytes(4, "big") * repetitions


def parcel(seq: int, product: str = KEPT) -> NewProduct:
    """Return the product with this number."""
    header = Header(
        product_id("mana", "kill", product, seq * S, seq, "c"),
        seq,
        seq * S,
        seq * S,
        "site",
        "kill/1",
        config_hash="c",
        box_m=(float(seq), 0.0, 0.0, seq + 0.5, 1.0, 1.0),
        inputs=("sensor",),
    )
    return NewProduct(header, payload(seq), "mana", "kill", product, product, "ElevationMap")


def report(what: str, **fields: Any) -> None:
    """Write one line with a single system call."""
    os.write(1, (json.dumps({"what": what, **fields}) + "\n").encode())


class Writer:
    """Inserts, tags and deletes products and re-anchors a frame, in one thread."""

    def __init__(self, store: Store, seed: int, seqs: itertools.count[int], number: int) -> None:
        self._store = store
        self._rng = random.Random(seed * WRITERS + number)
        self._seqs = seqs
        self._number = number
        self._seqs_of_thread: list[int] = []

    def run(self) -> None:
        """Run operations until the process ends."""
        while True:
            operation = self._rng.choices(
                ("put", "scratch", "batch", "tag", "delete", "frame"), (6, 3, 2, 4, 2, 1)
            )[0]
            getattr(self, operation)()

    def put(self) -> None:
        """Insert one product."""
        seq = next(self._seqs)
        report("put", seqs=[seq])
        self._store.put_all([parcel(seq)])
        report("put done", seqs=[seq])
        self._seqs_of_thread.append(seq)

    def scratch(self) -> None:
        """Insert one product that retention may delete."""
        self._store.put_all([parcel(next(self._seqs), SCRATCH)])

    def batch(self) -> None:
        """Insert some products in one transaction."""
        seqs = [next(self._seqs) for _ in range(self._rng.randrange(2, 12))]
        report("put", seqs=seqs)
        self._store.put_all([parcel(seq) for seq in seqs])
        report("put done", seqs=seqs)
        self._seqs_of_thread += seqs

    def tag(self) -> None:
        """Change the tags of a product."""
        if self._seqs_of_thread:
            seq = self._rng.choice(self._seqs_of_thread)
            product = parcel(seq).header.id
            revision = self._store.annotations.get(product).revision
            tags = [f"n{self._rng.randrange(1000)}"]
            report("tag", seq=seq, revision=revision + 1, tags=tags)
            self._store.annotations.update(product, {"tags": tags}, if_match=revision)
            report("tag done", seq=seq, revision=revision + 1, tags=tags)

    def delete(self) -> None:
        """Delete a product."""
        if self._seqs_of_thread:
            seq = self._seqs_of_thread.pop(self._rng.randrange(len(self._seqs_of_thread)))
            report("delete", seq=seq)
            self._store.delete(parcel(seq).header.id)
            report("delete done", seq=seq)
            if self._rng.random() < 0.3:
                self._store.purge(parcel(seq).header.id)

    def frame(self) -> None:
        """Re-anchor the frame of this thread."""
        name, x = f"kill/frame{self._number}", self._rng.random()
        T = UncertainTransform(se3.transform(np.eye(3), (x, 0.0, 0.0)))
        report("frame", frame=name, x=x)
        revision = self._store.frames.set(name, "site", T)
        report("frame done", frame=name, x=x, revision=revision.revision)


def maintain(store: Store, copies: Path) -> None:
    """Run retention, collection and backup in turn until the process ends."""
    for number in itertools.count():
        store.retention.apply(RULES)
        store.collect()
        target = copies / f"{os.getpid()}-{number}"
        backup(store.directory, target)
        report("backup done", path=str(target))
        shutil.rmtree(copies / f"{os.getpid()}-{number - 1}", ignore_errors=True)


def main() -> None:
    """Run the load until the process is killed."""
    directory, seed, first = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    with open_store(f"sqlite:///{directory / 'data'}") as store:
        seqs = itertools.count(first)
        for number in range(WRITERS):
            threading.Thread(target=Writer(store, seed, seqs, number).run, daemon=True).start()
        maintain(store, directory / "copies")


if __name__ == "__main__":
    main()
