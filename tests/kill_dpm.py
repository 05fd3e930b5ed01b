# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Kill the store at random moments of a mixed load, and look whether everything acknowledged is there, whole.

    python -m tests.kill_dpm [--runs 200] [--seed 0] [--out FILE]

The load (``tests.kill_load``) inserts, inserts in batches, tags, deletes, re-anchors, retires, collects and backs up,
in three threads, and tells each operation before and after. It is killed with SIGKILL some moments after its first
acknowledgement; then the store is opened and compared with what was told. All runs share one store. The summary is
JSON: runs, acknowledged operations, and every finding; exit 1 if there is any.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_common.geometry.region import Region
from dpm_store import Query, Store, open_store
from dpm_store.backup import restore
from tests.kill_load import KEPT, parcel, payload

ROOT = Path(__file__).resolve().parent.parent
#: Products of earlier runs that are looked at after each run; all of them after the last.
_OLD = 100
_RESTORED_EVERY = 25
#: Part of the runs that are killed while they start.
_EARLY = 0.1


@dataclass
class Told:
    """What the load said, over all runs."""

    put: set[int] = field(default_factory=set)
    batches: list[list[int]] = field(default_factory=list)
    intended: dict[int, list[int]] = field(default_factory=dict)
    deleting: set[int] = field(default_factory=set)
    deleted: set[int] = field(default_factory=set)
    tags: dict[int, tuple[int, list[str]]] = field(default_factory=dict)
    tagging: dict[int, tuple[int, list[str]]] = field(default_factory=dict)
    frames: dict[str, dict[int, float]] = field(default_factory=dict)
    copies: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)

    def hear(self, line: dict[str, Any]) -> None:
        """Take one line in."""
        what = line["what"]
        self.counts[what] += 1
        if what == "put":
            self.intended |= dict.fromkeys(line["seqs"], line["seqs"])
        elif what == "put done":
            self.put |= set(line["seqs"])
        elif what == "tag":
            self.tagging[line["seq"]] = (line["revision"], line["tags"])
        elif what == "tag done":
            self.tags[line["seq"]] = (line["revision"], line["tags"])
        elif what == "delete":
            self.deleting.add(line["seq"])
        elif what == "delete done":
            self.deleted.add(line["seq"])
        elif what == "frame done":
            self.frames.setdefault(line["frame"], {})[line["revision"]] = line["x"]
        elif what == "backup done":
            self.copies.append(line["path"])


def run_and_kill(directory: Path, seed: int, first: int, wait_s: float, told: Told, *, early: bool) -> set[int]:
    """One run, killed so long after its first line, or where ``early`` after its start; the numbers it used."""
    command = [sys.executable, "-m", "tests.kill_load", str(directory), str(seed), str(first)]
    before = set(told.intended)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as load:
        assert load.stdout is not None
        heard: list[str] = []
        if early:
            with contextlib.suppress(subprocess.TimeoutExpired):
                load.wait(wait_s)
        else:
            heard.append(load.stdout.readline())
            kill_at = time.monotonic() + wait_s
            while heard[-1] and time.monotonic() < kill_at:
                heard.append(load.stdout.readline())
        if load.poll() is not None:
            raise RuntimeError(f"the load ended by itself with {load.returncode}")
        load.send_signal(signal.SIGKILL)
        heard += load.stdout.readlines()
    for line in heard:
        if line.endswith("\n"):
            told.hear(json.loads(line))
    return set(told.intended) - before


def findings(store: Store, told: Told, seqs: set[int]) -> list[str]:
    """What is not as it was told."""
    found = [f"{problem.where}: {problem.what}" for problem in store.verify()]
    present = {seq: there for seq in seqs if (there := _present(store, seq, found)) is not None}
    for seq in seqs:
        if seq in told.put and seq not in told.deleting and not present[seq]:
            found.append(f"product {seq}: acknowledged and lost")
        if seq in told.deleted and present[seq]:
            found.append(f"product {seq}: deleted and there again")
        whole = {present[other] for other in told.intended[seq] if other in present and other not in told.deleting}
        if len(whole) > 1:
            found.append(f"batch of product {seq}: a part of it is there")
        if seq in told.tags and seq not in told.deleting:
            now = store.annotations.get(parcel(seq).header.id)
            if (now.revision, list(now.tags)) not in (told.tags[seq], told.tagging[seq]):
                found.append(f"product {seq}: revision {now.revision} {now.tags}, acknowledged {told.tags[seq]}")
    for seq in sorted(present)[:: max(1, len(present) // 20)]:
        region = Region("bbox", (seq + 0.1, 0.1, seq + 0.2, 0.2))
        listed = [r.header.seq for r in store.search(Query(types=(KEPT,), region=region)).items]
        if listed != ([seq] if present[seq] else []):
            found.append(f"product {seq}: there {present[seq]}, found by region {listed}")
    for frame, revisions in told.frames.items():
        there = {r.revision: float(r.T_parent_frame.matrix[0, 3]) for r in store.frames.revisions(frame)}
        found += [f"frame {frame} revision {r}: lost" for r, x in revisions.items() if there.get(r) != x]
    return found


def _present(store: Store, seq: int, found: list[str]) -> bool | None:
    """Whether a product is there; one that is not whole is a finding."""
    product = parcel(seq).header.id
    try:
        if store.payload(product) != payload(seq) or store.get(product).header.seq != seq:
            found.append(f"product {seq}: torn")
    except ProductNotFoundError:
        return False
    except CdffError as error:
        found.append(f"product {seq}: {error}")
    return True


def campaign(directory: Path, runs: int, seed: int) -> dict[str, Any]:
    """All runs; the summary."""
    rng, told, found = random.Random(seed), Told(), []
    (directory / "copies").mkdir()
    began = time.monotonic()
    for run in range(runs):
        new = run_and_kill(
            directory, seed * 100_000 + run, run * 100_000, rng.random() ** 2, told, early=rng.random() < _EARLY
        )
        last = run == runs - 1
        older = sorted(set(told.intended) - new)
        looked_at = new | (set(older) if last else set(rng.sample(older, min(_OLD, len(older)))))
        with open_store(f"sqlite:///{directory / 'data'}") as store:
            found += [f"run {run}: {finding}" for finding in findings(store, told, looked_at)]
        if told.copies and (last or run % _RESTORED_EVERY == 0):
            found += [
                f"run {run}: copy: {finding}" for finding in _of_copy(Path(told.copies[-1]), directory / "restored")
            ]
        for copy in (directory / "copies").iterdir():
            shutil.rmtree(copy)
        told.copies.clear()
    verified = subprocess.run(
        [sys.executable, "-m", "cdff_common.cli", "dpm", "verify", "--data-dir", str(directory / "data"), "--json"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return {
        "runs": runs, "seed": seed, "told": dict(told.counts), "verify": json.loads(verified.stdout or "null"),
        "findings": found, "seconds": round(time.monotonic() - began),
    }  # fmt: skip


def _of_copy(copy: Path, target: Path) -> list[str]:
    restore(copy, target)
    with open_store(f"sqlite:///{target}") as store:
        found = [f"{problem.where}: {problem.what}" for problem in store.verify()]
    shutil.rmtree(target)
    return found


def main() -> int:
    """Run, print the summary; 1 where anything was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dir", type=Path, default=None, help="where to make the store")
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.dir) as directory:
        summary = campaign(Path(directory), args.runs, args.seed)
    text = json.dumps(summary, indent=2) + "\n"
    print(text, end="")
    if args.out is not None:
        args.out.write_text(text)
    clean = not summary["findings"] and summary["verify"] is not None and not summary["verify"]["problems"]
    return 0 if clean else 1


if __name__ == "__main__":
    raise SystemExit(main())
