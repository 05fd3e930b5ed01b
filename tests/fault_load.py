# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Everything that a store writes, with one call of the system failing at each place in turn.

    LD_PRELOAD=faults.so python -m tests.fault_load EMPTY DIR [STRIDE]

EMPTY is the directory of an empty store. Prints JSON: how many failures were injected by call, file and error, and what
was not as it should be: an error that has no type of ours, an acknowledged change that is lost, a store that is not
sound or not usable afterwards.
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
from dpm_store import Rule, Store, open_store, sqlite
from dpm_store.backup import backup
from tests.kill_load import SCRATCH, parcel, payload

CALLS = {"write": 0, "sync": 1, "rename": 2, "unlink": 3, "truncate": 4}
PLACES = (
    ("write", "store.sqlite"), ("sync", "store.sqlite"), ("truncate", "store.sqlite"), ("write", "/blobs"),
    ("sync", "/blobs"), ("rename", "/blobs"), ("unlink", "/blobs"),
    ("write", "/packs"), ("sync", "/packs"), ("truncate", "/packs"),
)  # fmt: skip
ERRORS = ("EIO", "ENOSPC")
_ALL = 1 << 30


class Script:
    """Operations on a store; each tells whether it was acknowledged."""

    def __init__(self, store: Store, copy: Path) -> None:
        self._store = store
        self._copy = copy
        self.acknowledged: set[str] = set()
        self.problems: list[str] = []

    def run(self) -> None:
        """Try every operation, whatever became of those before."""
        store = self._store
        x = UncertainTransform(se3.transform(np.eye(3), (1.0, 0.0, 0.0)))
        steps: dict[str, Callable[[], object]] = {
            "inline": lambda: store.put_all([parcel(1)]),
            "file": lambda: store.put_all([parcel(5)]),
            "batch": lambda: store.put_all([parcel(seq) for seq in (6, 7, 10, 15)]),
            "tag": lambda: store.annotations.update(parcel(5).header.id, {"tags": ["t"]}, if_match=None),
            "frame": lambda: store.frames.set("a", "site", x),
            "gone": lambda: store.delete(parcel(6).header.id),
            "scratch": lambda: store.put_all([parcel(20, SCRATCH), parcel(21, SCRATCH)]),
            "retire": lambda: store.retention.apply([Rule(SCRATCH, max_count=1)]),
            "collect": store.collect,
            "fold": lambda: sqlite.fold_log(store._database.engine),
            "backup": lambda: backup(store.directory, self._copy),
            "last": lambda: store.put_all([parcel(30)]),
        }
        for name, step in steps.items():
            try:
                step()
                self.acknowledged.add(name)
            except (StorageError, ProductNotFoundError):
                continue  # typed; what was not stored cannot be found
            except Exception as error:  # noqa: BLE001  # this is what is looked for
                self.problems.append(f"{name}: {type(error).__name__}: {error}")

    def check(self, store: Store) -> None:
        """Compare a store with what was acknowledged, then use it."""
        self.problems += [f"{p.where}: {p.what}" for p in store.verify()]
        there = {seq for seq in (1, 5, 6, 7, 10, 15, 30) if self._is_whole(store, seq)}
        wanted = {"inline": {1}, "file": {5}, "batch": {7, 10, 15}, "last": {30}}
        for name, seqs in wanted.items():
            if name in self.acknowledged and not seqs <= there:
                self.problems.append(f"{name}: acknowledged and lost")
        if len({seq in there for seq in (7, 10, 15)}) > 1:
            self.problems.append("batch: a part of it is there")
        if "gone" in self.acknowledged and 6 in there:
            self.problems.append("gone: deleted and there again")
        if "tag" in self.acknowledged and store.annotations.get(parcel(5).header.id).tags != ("t",):
            self.problems.append("tag: acknowledged and lost")
        if "frame" in self.acknowledged and len(store.frames.revisions("a")) != 1:
            self.problems.append("frame: acknowledged and lost")
        store.put_all([parcel(100), parcel(105)])
        store.delete(parcel(100).header.id)
        store.collect()
        if store.payload(parcel(105).header.id) != payload(105):
            self.problems.append("not usable afterwards")

    def _is_whole(self, store: Store, seq: int) -> bool:
        try:
            if store.payload(parcel(seq).header.id) == payload(seq):
                return True
        except ProductNotFoundError:
            return False
        self.problems.append(f"product {seq}: torn")
        return True


def main() -> None:
    """All places, all errors, each failing once and from then on."""
    empty, work = Path(sys.argv[1]), Path(sys.argv[2])
    stride = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    faults = ctypes.CDLL(None)
    injected: Counter[str] = Counter()
    problems = []
    for call, place in PLACES:
        for name in ERRORS:
            for times in (1, _ALL):
                for at in range(0, 10_000, stride):
                    shutil.copytree(empty, work / "data")
                    with open_store(f"sqlite:///{work / 'data'}", ManualClock(10**12)) as store:
                        script = Script(store, work / "copy")
                        arguments = (CALLS[call], place.encode(), at, times, getattr(errno, name))
                        faults.faults_arm(*arguments)
                        script.run()
                        count = faults.faults_injected()
                        faults.faults_arm(-1, b"", 0, 0, 0)
                        script.check(store)
                    with open_store(f"sqlite:///{work / 'data'}", ManualClock(10**12)) as store:
                        script.problems += [f"opened again: {p.where}: {p.what}" for p in store.verify()]
                    shutil.rmtree(work)
                    work.mkdir()
                    how = "once" if times == 1 else "on"
                    injected[f"{call} {place} {name}"] += count
                    problems += [f"{call} {place} {name} {at} {how}: {problem}" for problem in script.problems]
                    if count == 0:
                        break
    print(json.dumps({"injected": injected, "problems": problems}))


if __name__ == "__main__":
    main()
