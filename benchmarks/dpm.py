# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The store beside the raw engine in one run: durable insertions, and searches by region, time and type.

    python benchmarks/dpm.py [--products 20000] [--searches 500] [--out FILE]

Ours is ``dpm_store``; raw is ``sqlite3`` with the same pragmas, a product table, an R*Tree and a payload column, with
nothing checked, hashed or told. Payloads are 10 kB, boxes about 5 m in 1 km x 1 km, searches 30 m x 30 m over all time
with a limit of 100. Each insertion is one durable commit.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import sqlite3
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from cdff_common.clock import ManualClock
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header, product_id
from dpm_store import Query, open_store

PAYLOAD_BYTES = 10_000
SIDE_M, WINDOW_M = 1000.0, 30.0
S = 1_000_000_000


def boxes(count: int) -> list[tuple[float, ...]]:
    """Boxes of mixed size."""
    rng = random.Random(1)
    found = []
    for _ in range(count):
        x, y, size = rng.uniform(0, SIDE_M), rng.uniform(0, SIDE_M), rng.lognormvariate(1.5, 0.6)
        found.append((x, y, 0.0, x + size, y + size, 1.0))
    return found


def windows(count: int) -> list[tuple[float, float, float, float]]:
    """Search windows."""
    rng = random.Random(2)
    corners = [(rng.uniform(0, SIDE_M), rng.uniform(0, SIDE_M)) for _ in range(count)]
    return [(x, y, x + WINDOW_M, y + WINDOW_M) for x, y in corners]


def timed(calls: list[Callable[[], object]]) -> dict[str, float]:
    """Milliseconds per call: median, 99th percentile, and CPU time of the process per call."""
    spans, cpu_s = [], time.process_time()
    for call in calls:
        start = time.perf_counter()
        call()
        spans.append((time.perf_counter() - start) * 1e3)
    cpu_ms = (time.process_time() - cpu_s) * 1e3 / len(calls)
    spans.sort()
    return {"p50_ms": spans[len(spans) // 2], "p99_ms": spans[int(len(spans) * 0.99)], "cpu_ms": cpu_ms}


def ours(directory: Path, products: int, asked: list[tuple[float, float, float, float]]) -> dict[str, dict[str, float]]:
    """Figures of the store."""
    payload = os.urandom(PAYLOAD_BYTES - 8)
    names = {"robot": "mana", "dfpc": "mapper", "port": "map", "product": "dem", "type_name": "ElevationMap"}
    with open_store(f"sqlite:///{directory}", ManualClock(S)) as store:

        def insertion(seq: int, box: tuple[float, ...]) -> Callable[[], object]:
            header = Header(
                product_id("mana", "mapper", "map", seq * S, seq, "c"),
                seq,
                seq * S,
                seq * S,
                "site",
                "mapper/1",
                config_hash="c",
                box_m=box,
                resolution_m=0.1,
            )  # type: ignore[arg-type]  # six numbers
            return lambda: store.put(header, payload + seq.to_bytes(8, "big"), **names)

        def search(window: tuple[float, float, float, float]) -> Callable[[], object]:
            query = Query(types=("dem",), region=Region("bbox", window), t0_ns=0, t1_ns=products * S)
            return lambda: store.search(query)

        inserted = timed([insertion(seq, box) for seq, box in enumerate(boxes(products))])
        return {"insert": inserted, "search": timed([search(window) for window in asked])}


def raw(directory: Path, products: int, asked: list[tuple[float, float, float, float]]) -> dict[str, dict[str, float]]:
    """Figures of the engine alone."""
    db = sqlite3.connect(directory / "raw.sqlite", isolation_level=None)
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "cache_size=-32768", "wal_autocheckpoint=4000"):
        db.execute(f"PRAGMA {pragma}")
    db.execute("CREATE TABLE product (id INTEGER PRIMARY KEY, name TEXT UNIQUE, type TEXT, t1 INTEGER, payload BLOB)")
    db.execute("CREATE VIRTUAL TABLE box USING rtree(id, x0, x1, y0, y1, z0, z1, t0, t1)")
    payload = os.urandom(PAYLOAD_BYTES)

    def insertion(seq: int, b: tuple[float, ...]) -> Callable[[], object]:
        def call() -> None:
            db.execute("BEGIN IMMEDIATE")
            db.execute("INSERT INTO product VALUES (?, ?, 'dem', ?, ?)", (seq, str(seq), seq * S, payload))
            db.execute(
                "INSERT INTO box VALUES (?,?,?,?,?,?,?,?,?)", (seq, b[0], b[3], b[1], b[4], b[2], b[5], seq, seq)
            )
            db.execute("COMMIT")

        return call

    statement = (
        "SELECT id, name, type, t1 FROM product WHERE type = 'dem' AND id IN (SELECT id FROM box WHERE x0 <= ? AND "
        "x1 >= ? AND y0 <= ? AND y1 >= ? AND t0 <= ? AND t1 >= 0) ORDER BY t1 DESC, id DESC LIMIT 100"
    )

    def search(w: tuple[float, float, float, float]) -> Callable[[], object]:
        return lambda: db.execute(statement, (w[2], w[0], w[3], w[1], products)).fetchall()

    inserted = timed([insertion(seq, box) for seq, box in enumerate(boxes(products))])
    figures = {"insert": inserted, "search": timed([search(window) for window in asked])}
    db.close()
    return figures


def file_system(directory: Path) -> str:
    """Kind of file system that a directory is on."""
    return subprocess.run(
        ["stat", "-f", "-c", "%T", str(directory)], capture_output=True, text=True, check=True
    ).stdout.strip()


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--products", type=int, default=20_000)
    parser.add_argument("--searches", type=int, default=500)
    parser.add_argument("--dir", type=Path, default=None, help="where to write; the file system matters")
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.dir) as base:
        asked = windows(args.searches)
        results = {}
        for name, measure in (("raw", raw), ("ours", ours)):
            directory = Path(base) / name
            directory.mkdir()
            results[name] = measure(directory, args.products, asked)
        about = {
            "products": args.products,
            "payload_bytes": PAYLOAD_BYTES,
            "file_system": file_system(Path(base)),
            "sqlite": sqlite3.sqlite_version,
            "python": platform.python_version(),
        }
    print(", ".join(f"{k} {v}" for k, v in about.items()))
    for operation in ("insert", "search"):
        for name in ("raw", "ours"):
            figures = results[name][operation]
            print(f"{operation:8}{name:6}" + "".join(f"{k} {v:9.3f}   " for k, v in figures.items()))
    if args.out is not None:
        args.out.write_text(json.dumps({"about": about, **results}, indent=1))


if __name__ == "__main__":
    main()
