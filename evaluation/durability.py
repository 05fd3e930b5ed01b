# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate acknowledged changes after crashes during writes: the store of the DPM, and PostgreSQL.

The DPM's store runs in the process of the writers, which SIGKILL ends. The server of PostgreSQL is stopped
by ``pg_ctl stop -m immediate``, which leaves its data folder as a crash does. Both have two writers, the same
products and the same disk; every commit is synced.
"""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.errors import StorageError
from cdff_common.geometry.se3 import FloatArray
from evaluation.peers.postgresql import PostgresProducts, PostgreSQL, binaries, seconds_until_first_answer
from evaluation.runs.durability_load import Products, StoreProducts, payload, product

OPTIONS = {"seed": 1, "count": 20}
ROOT = Path(__file__).resolve().parents[1]
#: Longest time of writing before a crash, seconds.
_WRITING_S = 4.0
#: Word of the lines of acknowledged insertions, and number of these lines before the time counts.
_STORED, _WARM_UP = '"stored"', 4
#: Numbers of products of one run.
_PER_RUN = 1_000_000


@dataclass(slots=True)
class Reports:
    """Operations that the writers reported: those that began, and those that were acknowledged."""

    began: list[list[int]] = field(default_factory=list)
    stored: set[int] = field(default_factory=set)
    deleting: set[int] = field(default_factory=set)
    deleted: set[int] = field(default_factory=set)

    def add(self, lines: list[str]) -> None:
        """Add the complete lines of a process."""
        for line in (json.loads(text) for text in lines if text.endswith("\n")):
            seqs = line["seqs"]
            if line["what"] == "put":
                self.began.append(seqs)
            elif line["what"] in ("stored", "deleted"):
                getattr(self, line["what"]).update(seqs)
            elif line["what"] == "delete":
                self.deleting.update(seqs)


def write_until(
    kind: str, place: str, seed: int, run: int, wait_s: float, crash: Callable[[Any], None]
) -> tuple[list[str], float, int]:
    """Run the writers and crash the store ``wait_s`` after the first acknowledged insertions.

    Return the lines of the writers, and seconds and acknowledged insertions of this time.
    """
    command = [sys.executable, "-m", "evaluation.runs.durability_load", kind, place, str(seed)]
    with subprocess.Popen(
        [*command, str(run * _PER_RUN)], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as load:
        assert load.stdout is not None
        lines: list[str] = []
        while sum(_STORED in line for line in lines) < _WARM_UP:
            lines.append(load.stdout.readline())
            if not lines[-1]:
                raise StorageError(f"the writers of {kind} ended with code {load.wait()}")
        warm, start_s = len(lines), time.monotonic()
        while lines[-1] and time.monotonic() - start_s < wait_s:
            lines.append(load.stdout.readline())
        crash(load)
        written_s = time.monotonic() - start_s
        lines += load.stdout.readlines()
    stored = sum(len(json.loads(line)["seqs"]) for line in lines[warm:] if _STORED in line)
    return lines, written_s, stored


def findings(products: Products, reports: Reports) -> dict[str, int]:
    """Return the numbers of lost, resurrected, corrupt and partly stored products."""
    counts = dict.fromkeys(("lost", "resurrected", "corrupt", "partial batches"), 0)
    for batch in reports.began:
        stored_payloads = {seq: products.payload(product(seq).header.id) for seq in batch}
        counts["corrupt"] += sum(v is not None and v != payload(seq) for seq, v in stored_payloads.items())
        for seq, value in stored_payloads.items():
            counts["lost"] += seq in reports.stored and seq not in reports.deleting and value is None
            counts["resurrected"] += seq in reports.deleted and value is not None
        counts["partial batches"] += (
            len({v is None for s, v in stored_payloads.items() if s not in reports.deleting}) > 1
        )
    return counts


def summary(
    reports: Reports, counts: dict[str, int], rates: FloatArray, recovery_s: list[float]
) -> dict[str, Any]:
    """Return the figures of a store; ``rates`` are seconds of writing and insertions in this time."""
    return {
        "crashes": len(recovery_s),
        "acknowledged insertions": len(reports.stored),
        "acknowledged deletions": len(reports.deleted),
        **counts,
        "insertions per second": round(float(rates[1] / rates[0]), 1),
        "recovery, median s": round(float(np.median(recovery_s)), 2),
        "recovery, longest s": round(max(recovery_s), 2),
    }


def store(folder: Path, seed: int, count: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Kill the writers with the store of the DPM; return the figures."""
    rng, reports, rates = random.Random(seed), Reports(), np.zeros(2)
    recovery_s: list[float] = []
    for run in range(count):
        progress(f"durability: store, crash {run + 1} of {count}")
        wait_s = rng.random() * _WRITING_S
        lines, *rate = write_until(
            "store", str(folder), seed + run, run, wait_s, lambda load: load.send_signal(signal.SIGKILL)
        )
        reports.add(lines)
        rates += rate
        start_s = time.monotonic()
        products = StoreProducts(str(folder))
        products.payload(product(0).header.id)
        recovery_s.append(time.monotonic() - start_s)
        counts = findings(products, reports) if run == count - 1 else {}
        products.close()
    return summary(reports, counts, rates, recovery_s)


def postgresql(folder: Path, seed: int, count: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Stop PostgreSQL immediately during writes; return the figures."""
    rng, reports, rates = random.Random(seed), Reports(), np.zeros(2)
    recovery_s: list[float] = []
    server = PostgreSQL(folder)
    server.start()
    try:
        tables = PostgresProducts(server.dsn)
        tables.create_tables()
        tables.close()
        for run in range(count):
            progress(f"durability: PostgreSQL, crash {run + 1} of {count}")
            wait_s = rng.random() * _WRITING_S
            lines, *rate = write_until(
                "postgresql", server.dsn, seed + run, run, wait_s, lambda _: server.stop("immediate")
            )
            reports.add(lines)
            rates += rate
            recovery_s.append(seconds_until_first_answer(server, product(0).header.id))
        products = PostgresProducts(server.dsn)
        counts = findings(products, reports)
        products.close()
    finally:
        server.stop("fast")
    return {"version": server.version} | summary(reports, counts, rates, recovery_s)


def evaluate(
    data: Path, progress: Callable[[str], None], seed: int = OPTIONS["seed"], count: int = OPTIONS["count"]
) -> dict[str, Any]:
    """Return the figures of both stores; without PostgreSQL or psycopg only those of the DPM's store."""
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        figures = {"seed": seed, "store of the DPM": store(folder / "store", seed, count, progress)}
        if binaries() is None:
            progress("durability: no PostgreSQL server or no psycopg; skipped")
        else:
            figures["PostgreSQL"] = postgresql(folder / "postgresql", seed, count, progress)
    return figures


def table(figures: dict[str, Any]) -> str:
    """Return a table of both stores."""
    names = [name for name in figures if name != "seed"]
    titles = [f"{name} {figures[name].get('version', '')}".strip() for name in names]
    lines = [f"| quantity | {' | '.join(titles)} |", "|---" * (1 + len(names)) + "|"]
    lines += [
        f"| {key} | {' | '.join(str(figures[name][key]) for name in names)} |" for key in figures[names[0]]
    ]
    return "\n".join(lines)
