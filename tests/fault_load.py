# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Write to a store while one system call fails; repeat with the failure at every possible call.

    LD_PRELOAD=faults.so python -m tests.fault_load EMPTY DIR [STRIDE]

EMPTY is the directory of an empty store. Prints JSON: the number of injected failures for each call, file
and error, and the problems: an untyped error, a lost acknowledged change, a store that is corrupt or
unusable afterwards.
"""

from __future__ import annotations

import ctypes
import errno
import json
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cdff_common.clock import ManualClock
from cdff_common.errors import ProductNotFoundError, StorageError
from cdff_common.geometry import UncertainTransform, se3
from dpm_store import Rule, Store, open_store
from dpm_store.engine.database import EMBEDDED
from dpm_store.history.backup import backup
from tests.kill_load import SCRATCH, parcel, payload

CALLS = {"write": 0, "sync": 1, "rename": 2, "unlink": 3, "truncate": 4}
TARGETS = (
    ("write", "store.sqlite"),
    ("sync", "store.sqlite"),
    ("truncate", "store.sqlite"),
    ("write", "/blobs"),
    ("sync", "/blobs"),
    ("rename", "/blobs"),
    ("unlink", "/blobs"),
    ("write", "/packs"),
    ("sync", "/packs"),
    ("truncate", "/packs"),
)
ERRORS = ("EIO", "ENOSPC")
_ALL = 1 << 30


class Script:
    """Runs operations on a store and records the acknowledged ones."""

    def __init__(self, store: Store, copy: Path) -> None:
        self._store = store
        self._copy = copy
        self.acknowledged: set[str] = set()
        self.problems: list[str] = []

    def run(self) -> None:
        """Run every operation, also after failures."""
        store = self._store
        T_site_a = UncertainTransform(se3.transform(np.eye(3), (1.0, 0.0, 0.0)))
        steps: dict[str, Callable[[], object]] = {
            "inline": lambda: store.put_all([parcel(1)]),
            "file": lambda: store.put_all([parcel(5)]),
            "batch": lambda: store.put_all([parcel(seq) for seq in (6, 7, 10, 15)]),
            "tag": lambda: store.annotations.update(parcel(5).header.id, {"tags": ["t"]}, if_match=None),
            "frame": lambda: store.frames.set("a", "site", T_site_a),
            "delete": lambda: store.delete(parcel(6).header.id),
            "scratch": lambda: store.put_all([parcel(20, SCRATCH), parcel(21, SCRATCH)]),
            "retire": lambda: store.retention.apply([Rule(product=SCRATCH, max_count=1)]),
            "collect": store.collect,
            "checkpoint": lambda: EMBEDDED.checkpoint(store._database.engine),
            "backup": lambda: backup(store.directory, self._copy),
            "last": lambda: store.put_all([parcel(30)]),
        }
        for name, step in steps.items():
            try:
                step()
                self.acknowledged.add(name)
            except (StorageError, ProductNotFoundError):
                continue  # typed, as expected
            except Exception as error:  # noqa: BLE001  # untyped errors are problems
                self.problems.append(f"{name}: {type(error).__name__}: {error}")

    def check(self, store: Store) -> None:
        """Compare a store with the acknowledged operations, then use it."""
        self.problems += [f"{p.where}: {p.what}" for p in store.verify()]
        present = {seq for seq in (1, 5, 6, 7, 10, 15, 30) if self._is_whole(store, seq)}
        seqs_of_operation = {"inline": {1}, "file": {5}, "batch": {7, 10, 15}, "last": {30}}
        for name, seqs in seqs_of_operation.items():
            if name in self.acknowledged and not seqs <= present:
                self.problems.append(f"{name}: acknowledged and lost")
        if len({seq in present for seq in (7, 10, 15)}) > 1:
            self.problems.append("batch: only a part is stored")
        if "delete" in self.acknowledged and 6 in present:
            self.problems.append("delete: deleted and stored again")
        if "tag" in self.acknowledged and store.annotations.get(parcel(5).header.id).tags != ("t",):
            self.problems.append("tag: acknowledged and lost")
        if "frame" in self.acknowledged and len(store.frames.revisions("a")) != 1:
            self.problems.append("frame: acknowledged and lost")
        store.put_all([parcel(100), parcel(105)])
        store.delete(parcel(100).header.id)
        store.collect()
        if store.payload(parcel(105).header.id) != payload(105):
            self.problems.append("unusable afterwards")

    def _is_whole(self, store: Store, seq: int) -> bool:
        try:
            if store.payload(parcel(seq).header.id) == payload(seq):
                return True
        except ProductNotFoundError:
            return False
        self.problems.append(f"product {seq}: corrupt")
        return True


def main() -> None:
    """Inject all errors at all targets, once and permanently."""
    empty, work = Path(sys.argv[1]), Path(sys.argv[2])
    stride = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    faults = ctypes.CDLL(None)
    injected: Counter[str] = Counter()
    problems = []
    for call, target in TARGETS:
        for name in ERRORS:
            for times in (1, _ALL):
                for at in range(0, 10_000, stride):
                    shutil.copytree(empty, work / "data")
                    with open_store(f"sqlite:///{work / 'data'}", ManualClock(10**12)) as store:
                        script = Script(store, work / "copy")
                        arguments = (CALLS[call], target.encode(), at, times, getattr(errno, name))
                        faults.faults_arm(*arguments)
                        script.run()
                        count = faults.faults_injected()
                        faults.faults_arm(-1, b"", 0, 0, 0)
                        script.check(store)
                    with open_store(f"sqlite:///{work / 'data'}", ManualClock(10**12)) as store:
                        script.problems += [f"opened again: {p.where}: {p.what}" for p in store.verify()]
                    shutil.rmtree(work)
                    work.mkdir()
                    duration = "once" if times == 1 else "permanent"
                    injected[f"{call} {target} {name}"] += count
                    problems += [
                        f"{call} {target} {name} {at} {duration}: {problem}" for problem in script.problems
                    ]
                    if count == 0:
                        break
    print(json.dumps({"injected": injected, "problems": problems}))


if __name__ == "__main__":
    main()
