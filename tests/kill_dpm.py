# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Kill the store at random times under a mixed load, and check that every acknowledged change is stored.

    python -m tests.kill_dpm [--runs 200] [--seed 0] [--out FILE]

The load (``tests.kill_load``) inserts products singly and in batches, tags and deletes them, re-anchors
frames, applies retention, collects garbage and makes backups. It runs three threads and reports each
operation before and after. SIGKILL ends it shortly after its first report; then the store is opened and
compared with the reports. All runs share one store. The summary is JSON: runs, acknowledged operations and
findings. The exit code is 1 if there is a finding.
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
from dpm_store.history.backup import backup
from tests.kill_load import KEPT, parcel, payload

ROOT = Path(__file__).resolve().parent.parent
#: Number of products of earlier runs to check after each run; after the last run, all are checked.
_OLD_PRODUCTS = 100
_RESTORE_PERIOD = 25
#: Fraction of the runs that are killed during their start.
_EARLY_FRACTION = 0.1


@dataclass
class Reports:
    """Operations that the load reported, over all runs."""

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

    def add(self, line: dict[str, Any]) -> None:
        """Add one line of the load's output."""
        event = line["what"]
        self.counts[event] += 1
        if event == "put":
            self.intended |= dict.fromkeys(line["seqs"], line["seqs"])
        elif event == "put done":
            self.put |= set(line["seqs"])
        elif event == "tag":
            self.tagging[line["seq"]] = (line["revision"], line["tags"])
        elif event == "tag done":
            self.tags[line["seq"]] = (line["revision"], line["tags"])
        elif event == "delete":
            self.deleting.add(line["seq"])
        elif event == "delete done":
            self.deleted.add(line["seq"])
        elif event == "frame done":
            self.frames.setdefault(line["frame"], {})[line["revision"]] = line["x"]
        elif event == "backup done":
            self.copies.append(line["path"])


def run_and_kill(
    directory: Path, seed: int, first: int, wait_s: float, reports: Reports, *, early: bool
) -> set[int]:
    """Run the load, kill it after its first line or, if ``early``, during its start; return the new product
    numbers.
    """
    command = [sys.executable, "-m", "tests.kill_load", str(directory), str(seed), str(first)]
    before = set(reports.intended)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as load:
        assert load.stdout is not None
        lines: list[str] = []
        if early:
            with contextlib.suppress(subprocess.TimeoutExpired):
                load.wait(wait_s)
        else:
            lines.append(load.stdout.readline())
            kill_s = time.monotonic() + wait_s
            while lines[-1] and time.monotonic() < kill_s:
                lines.append(load.stdout.readline())
        if load.poll() is not None:
            raise RuntimeError(f"the load ended by itself with {load.returncode}")
        load.send_signal(signal.SIGKILL)
        lines += load.stdout.readlines()
    for line in lines:
        if line.endswith("\n"):
            reports.add(json.loads(line))
    return set(reports.intended) - before


def findings(store: Store, reports: Reports, seqs: set[int]) -> list[str]:
    """Return the differences between the store and the reports."""
    result = [f"{problem.where}: {problem.what}" for problem in store.verify()]
    present = {seq: stored for seq in seqs if (stored := _present(store, seq, result)) is not None}
    for seq in seqs:
        if seq in reports.put and seq not in reports.deleting and not present[seq]:
            result.append(f"product {seq}: acknowledged and lost")
        if seq in reports.deleted and present[seq]:
            result.append(f"product {seq}: deleted and stored again")
        batch_present = {
            present[other]
            for other in reports.intended[seq]
            if other in present and other not in reports.deleting
        }
        if len(batch_present) > 1:
            result.append(f"batch of product {seq}: only a part is stored")
        if seq in reports.tags and seq not in reports.deleting:
            annotation = store.annotations.get(parcel(seq).header.id)
            if (annotation.revision, list(annotation.tags)) not in (reports.tags[seq], reports.tagging[seq]):
                result.append(
                    f"product {seq}: revision {annotation.revision} {annotation.tags}, "
                    f"acknowledged {reports.tags[seq]}"
                )
    for seq in sorted(present)[:: max(1, len(present) // 20)]:
        region = Region("bbox", (seq + 0.1, 0.1, seq + 0.2, 0.2))
        matches = [r.header.seq for r in store.search(Query(types=(KEPT,), region=region)).items]
        if matches != ([seq] if present[seq] else []):
            result.append(f"product {seq}: stored {present[seq]}, search by region returned {matches}")
    for frame, revisions in reports.frames.items():
        stored_x = {r.revision: float(r.T_parent_frame.matrix[0, 3]) for r in store.frames.revisions(frame)}
        result += [f"frame {frame} revision {r}: lost" for r, x in revisions.items() if stored_x.get(r) != x]
    return result


def _present(store: Store, seq: int, problems: list[str]) -> bool | None:
    """Return True if a product is stored; append a finding if it is corrupt."""
    product = parcel(seq).header.id
    try:
        if store.payload(product) != payload(seq) or store.get(product).header.seq != seq:
            problems.append(f"product {seq}: corrupt")
    except ProductNotFoundError:
        return False
    except CdffError as error:
        problems.append(f"product {seq}: {error}")
    return True


def campaign(directory: Path, runs: int, seed: int) -> dict[str, Any]:
    """Execute all runs and return the summary."""
    rng, reports, result = random.Random(seed), Reports(), []
    (directory / "copies").mkdir()
    start_s = time.monotonic()
    for run in range(runs):
        new = run_and_kill(
            directory,
            seed * 100_000 + run,
            run * 100_000,
            rng.random() ** 2,
            reports,
            early=rng.random() < _EARLY_FRACTION,
        )
        is_last = run == runs - 1
        older = sorted(set(reports.intended) - new)
        checked = new | (set(older) if is_last else set(rng.sample(older, min(_OLD_PRODUCTS, len(older)))))
        with open_store(f"sqlite:///{directory / 'data'}") as store:
            result += [f"run {run}: {finding}" for finding in findings(store, reports, checked)]
        if reports.copies and (is_last or run % _RESTORE_PERIOD == 0):
            result += [
                f"run {run}: copy: {finding}"
                for finding in _findings_of_backup(Path(reports.copies[-1]), directory / "restored")
            ]
        for copy in (directory / "copies").iterdir():
            shutil.rmtree(copy)
        reports.copies.clear()
    verified = subprocess.run(
        [
            sys.executable,
            "-m",
            "cdff_common.cli",
            "dpm",
            "verify",
            "--data-dir",
            str(directory / "data"),
            "--json",
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return {
        "runs": runs,
        "seed": seed,
        "reported": dict(reports.counts),
        "verify": json.loads(verified.stdout or "null"),
        "findings": result,
        "seconds": round(time.monotonic() - start_s),
    }


def _findings_of_backup(copy: Path, target: Path) -> list[str]:
    backup(copy, target)
    with open_store(f"sqlite:///{target}") as store:
        result = [f"{problem.where}: {problem.what}" for problem in store.verify()]
    shutil.rmtree(target)
    return result


def main() -> int:
    """Execute the runs, print the summary, and return 1 if there are findings."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dir", type=Path, default=None, help="folder in which to create the store")
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.dir) as directory:
        summary = campaign(Path(directory), args.runs, args.seed)
    text = json.dumps(summary, indent=2) + "\n"
    print(text, end="")
    if args.out is not None:
        args.out.write_text(text)
    is_clean = not summary["findings"] and summary["verify"] is not None and not summary["verify"]["problems"]
    return 0 if is_clean else 1


if __name__ == "__main__":
    raise SystemExit(main())
