# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare the store of the DPM with plain SQLite: insertions, searches, re-anchoring, start, memory.

    python benchmarks/dpm.py [--products 20000] [--flat 1000,10000] [--searches 300] [--dir DIR] [--out FILE]

``store`` is ``dpm_store``. ``raw`` is ``sqlite3`` with the same pragmas, a product table, an R*Tree and a
payload column, without checks, hashes or events. Payloads have 10 kB and differ; boxes have about 5 m in an
area of 1 km x 1 km; there are ten types and one product per second. A search states a region, a time interval
and a type that select 0.1 % of the products, in three shapes (fraction of the area x fraction of the time),
with a limit of 100, newest first. Store and clients run on this machine; ``--access`` also measures HTTP and
Zenoh. ``--flat`` measures searches in smaller stores too. Times are medians of several calls with their CPU
times, for new and for repeated searches; ``sync_ms`` is the time of fsync of 4 kB on the same file system.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import resource
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

import numpy as np
import psutil

from cdff_common.bus import Bus, keys
from cdff_common.clock import ManualClock
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header, product_id
from cdff_dev.ports import free_port
from dpm_store import NewProduct, Query, Store, open_store

ROOT = Path(__file__).resolve().parent.parent
PAYLOAD_BYTES = 10_000
SIDE_M, BATCH = 1000.0, 2000
TYPES = (
    "pose",
    "trajectory",
    "pose_graph",
    "pointcloud",
    "dem",
    "navigation_map",
    "image",
    "detections",
    "track",
    "mesh",
)
#: Fractions of the area and of the time that a search selects; together with one type of ten it selects a
#: thousandth of the products.
SHAPES = {
    "area_0.1_time_0.1": (0.1, 0.1),
    "area_0.01_time_all": (0.01, 1.0),
    "area_all_time_0.01": (1.0, 0.01),
}
#: Nanoseconds in a second.
S = 1_000_000_000
PRAGMAS = ("journal_mode=WAL", "synchronous=FULL", "cache_size=-32768", "wal_autocheckpoint=4000")
Figures = dict[str, Any]


class Window(NamedTuple):
    """Parameters of a search: box, first and last second, and index of the type."""

    x0: float
    y0: float
    x1: float
    y1: float
    first_s: int
    last_s: int
    type_index: int


def boxes(count: int) -> Iterator[tuple[float, ...]]:
    """Yield boxes of different sizes."""
    rng = random.Random(1)
    for _ in range(count):
        x, y, size = rng.uniform(0, SIDE_M), rng.uniform(0, SIDE_M), rng.lognormvariate(1.5, 0.6)
        yield (x, y, 0.0, x + size, y + size, 1.0)


def search_windows(products: int, count: int, area: float, span: float) -> list[Window]:
    """Return the parameters of searches that select a fraction of the area and of the time."""
    rng, side, length = random.Random(2), SIDE_M * area**0.5, span * products
    results = []
    for _ in range(count):
        x, y = rng.uniform(0, SIDE_M - side), rng.uniform(0, SIDE_M - side)
        first_s = int(rng.uniform(0, products - length))
        type_index = rng.randrange(len(TYPES))
        results.append(Window(x, y, x + side, y + side, first_s, int(first_s + length), type_index))
    return results


def timed(calls: Sequence[Callable[[], object]]) -> Figures:
    """Return milliseconds per call: median, 99th percentile, and CPU time of this process."""
    spans, cpu_s = [], time.process_time()
    for call in calls:
        start = time.perf_counter()
        call()
        spans.append((time.perf_counter() - start) * 1e3)
    cpu_ms = (time.process_time() - cpu_s) * 1e3 / len(calls)
    return {"p50_ms": float(np.median(spans)), "p99_ms": float(np.percentile(spans, 99)), "cpu_ms": cpu_ms}


class InsertionCost:
    """Cost of calls that each store a batch: products per second, CPU time and bytes written."""

    def __init__(self) -> None:
        self._calls: list[tuple[int, float, float, int]] = []

    def add(self, count: int, call: Callable[[], object]) -> None:
        """Measure one call."""
        wall, cpu, written = time.perf_counter(), time.process_time(), _written()
        call()
        self._calls.append(
            (count, time.perf_counter() - wall, time.process_time() - cpu, _written() - written)
        )

    @property
    def figures(self) -> Figures:
        """Return the cost over all calls, and over the last tenth, when the store is nearly full."""
        tenth = self._calls[-max(1, len(self._calls) // 10) :]
        return {"all": self._figures(self._calls), "last_tenth": self._figures(tenth)}

    @staticmethod
    def _figures(calls: Sequence[tuple[int, float, float, int]]) -> Figures:
        count, wall, cpu, written = (sum(column) for column in zip(*calls, strict=True))
        return {"per_s": count / wall, "cpu_us": cpu * 1e6 / count, "written_kb": written / 1e3 / count}


def _written() -> int:
    """Return the number of bytes that this process has written."""
    return int(psutil.Process().io_counters().write_chars)


def products_of(first: int, boxes: Sequence[tuple[float, ...]], filler: bytes) -> list[NewProduct]:
    """Return products with the given boxes, one per second."""
    results = []
    for seq, box in enumerate(boxes, first):
        header = Header(
            product_id("mana", "mapper", "map", seq * S, seq, "c"),
            seq,
            seq * S,
            seq * S,
            "mana/map",
            "mapper/1",
            config_hash="c",
            box_m=box,
            resolution_m=0.1,
        )
        payload = filler + seq.to_bytes(8, "big")
        results.append(
            NewProduct(header, payload, "mana", "mapper", "map", TYPES[seq % len(TYPES)], "ElevationMap")
        )
    return results


def in_batches(count: int) -> Iterator[list[tuple[float, ...]]]:
    """Yield boxes in batches of ``BATCH``."""
    batch = []
    for box in boxes(count):
        batch.append(box)
        if len(batch) == BATCH:
            yield batch
            batch = []
    if batch:
        yield batch


def fill(store: Store, count: int) -> Figures:
    """Insert products in batches."""
    filler, first, cost = os.urandom(PAYLOAD_BYTES - 8), 0, InsertionCost()
    for batch in in_batches(count):
        new = products_of(first, batch, filler)
        cost.add(len(batch), lambda: store.put_all(new))  # noqa: B023  # called at once
        first += len(batch)
    return cost.figures


def searches(store: Store, products: int, count: int) -> Figures:
    """Return the times of searches of each shape."""

    def search(window: Window) -> Callable[[], object]:
        region = Region("bbox", window[:4])
        query = Query(
            types=(TYPES[window.type_index],),
            region=region,
            frame="mana/map",
            t0_ns=window.first_s * S,
            t1_ns=window.last_s * S,
        )
        return lambda: store.search(query)

    figures = {}
    for name, (area, span) in SHAPES.items():
        timed([search(w) for w in search_windows(products, 20, area, span)])  # warm-up
        calls = [search(w) for w in search_windows(products, count, area, span)]
        figures[name] = timed(calls) | {"again": timed(calls)}
    return figures


def measure_store(directory: Path, products: int, search_count: int) -> Figures:
    """Return the results of the store; searches run in a separate process to measure their memory."""
    url = f"sqlite:///{directory}"
    with open_store(url, ManualClock(S)) as store:
        figures: Figures = {"bulk": fill(store, products)}
        filler = os.urandom(PAYLOAD_BYTES - 8)
        singles = products_of(products + 1000, list(boxes(200)), filler)
        figures["insert"] = timed([lambda p=p: store.put_all((p,)) for p in singles])  # type: ignore[misc]
        T = [UncertainTransform(se3.transform(np.eye(3), (float(i), 0.0, 0.0))) for i in range(20)]
        figures["re_anchor"] = timed([lambda t=t: store.frames.set("mana/map", "site", t) for t in T])  # type: ignore[misc]
    figures["start"] = timed([lambda: open_store(url, ManualClock(S)).close() for _ in range(5)])
    command = [sys.executable, __file__, "--search-only", str(directory), "--products", str(products)]
    command += ["--searches", str(search_count)]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return figures | dict(json.loads(output))


def search_only(directory: Path, products: int, search_count: int) -> Figures:
    """Return the times of searches in this process, and its peak memory."""
    with open_store(f"sqlite:///{directory}", ManualClock(S)) as store:
        figures = {"search": searches(store, products, search_count)}
    return figures | {"rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def raw(directory: Path, products: int, search_count: int) -> Figures:
    """Return the results of plain SQLite."""
    with closing(sqlite3.connect(directory / "raw.sqlite", isolation_level=None)) as db:
        for pragma in PRAGMAS:
            db.execute(f"PRAGMA {pragma}")
        db.execute("CREATE TABLE product (id INTEGER PRIMARY KEY, name TEXT UNIQUE, type TEXT, t1 INTEGER)")
        db.execute("CREATE TABLE payload (id INTEGER PRIMARY KEY, content BLOB)")
        db.execute("CREATE VIRTUAL TABLE box USING rtree(id, f0, f1, x0, x1, y0, y1, z0, z1, t0, t1)")
        filler = os.urandom(PAYLOAD_BYTES - 8)

        def insert(first: int, batch: Sequence[tuple[float, ...]]) -> None:
            numbered = list(enumerate(batch, first))
            db.execute("BEGIN IMMEDIATE")
            rows = [(i, f"product-{i}", TYPES[i % len(TYPES)], i * S) for i, _ in numbered]
            db.executemany("INSERT INTO product VALUES (?, ?, ?, ?)", rows)
            db.executemany(
                "INSERT INTO payload VALUES (?, ?)", [(i, filler + i.to_bytes(8, "big")) for i, _ in numbered]
            )
            sides = [
                (i, i % len(TYPES), i % len(TYPES), x0, x1, y0, y1, z0, z1, i, i)
                for i, (x0, y0, z0, x1, y1, z1) in numbered
            ]
            db.executemany("INSERT INTO box VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", sides)
            db.execute("COMMIT")

        first, cost = 0, InsertionCost()
        for batch in in_batches(products):
            cost.add(len(batch), lambda: insert(first, batch))  # noqa: B023  # called at once
            first += len(batch)
        figures: Figures = {"bulk": cost.figures}
        singles = list(enumerate(boxes(200), products + 1000))
        figures["insert"] = timed([lambda i=i, b=b: insert(i, [b]) for i, b in singles])  # type: ignore[misc]
        statement = (
            "SELECT product.* FROM box CROSS JOIN product ON product.id = box.id WHERE f0 <= ? AND f1 >= "
            "? AND x0 <= ? AND x1 >= ? AND y0 <= ? AND y1 >= ? AND t0 <= ? AND box.t1 >= ? ORDER BY "
            "product.t1 DESC LIMIT 100"
        )

        def search(window: Window) -> Callable[[], object]:
            x0, y0, x1, y1, first_s, last_s, type_index = window
            values = (type_index, type_index, x1, x0, y1, y0, last_s, first_s)
            return lambda: db.execute(statement, values).fetchall()

        figures["search"] = {
            name: timed([search(w) for w in search_windows(products, search_count, *shape)])
            for name, shape in SHAPES.items()
        }
    return figures


def access(directory: Path, products: int, search_count: int) -> Figures:
    """Return the results of a DPM process over HTTP and Zenoh; replies are read, not decoded."""
    ports = [free_port(), free_port()]
    endpoint, address = f"tcp/127.0.0.1:{ports[0]}", f"127.0.0.1:{ports[1]}"
    environment = os.environ | {
        "CDFF_CONNECT": endpoint,
        "CDFF_LISTEN": endpoint,
        "CDFF_DATA_DIR": str(directory),
    }
    commands = (["services.router"], ["services.dpm", "--http", address])
    processes = [
        subprocess.Popen([sys.executable, "-m", *command], env=environment, cwd=ROOT) for command in commands
    ]
    started = time.perf_counter()
    try:
        with Bus.open(endpoint, name="bench", wait_s=30) as bus, closing(HTTPConnection(address)) as http:
            while not bus.alive(keys.alive(keys.GROUND, "dpm")):
                if time.perf_counter() - started > 60:
                    raise TimeoutError("the DPM did not start")
            figures: Figures = {"ready_s": time.perf_counter() - started}
            cpu = psutil.Process(processes[1].pid).cpu_times()
            figures["ready_cpu_s"] = cpu.user + cpu.system

            def over_http(parameters: dict[str, str]) -> None:
                http.request("GET", f"/api/v1/products?{urlencode(parameters)}")
                answer = http.getresponse()
                body = answer.read()
                if answer.status != 200:
                    raise RuntimeError(body.decode())

            def over_zenoh(parameters: dict[str, str]) -> None:
                bus.call(keys.dpm_rpc(keys.GROUND, "search"), parameters)

            for name, search in (("zenoh", over_zenoh), ("http", over_http)):
                figures[name] = {}
                for shape, (area, span) in SHAPES.items():
                    queries = [_parameters(w) for w in search_windows(products, search_count, area, span)]
                    calls = [lambda q=q, search=search: search(q) for q in queries]  # type: ignore[misc]
                    timed(calls[:20])
                    figures[name][shape] = timed(calls)
            memory = psutil.Process(processes[1].pid).memory_full_info()
            figures |= {"rss_mb": memory.rss / 2**20, "of_its_own_mb": memory.uss / 2**20}
        return figures
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def _parameters(window: Window) -> dict[str, str]:
    region = "bbox:" + ",".join(f"{v:.3f}" for v in window[:4])
    return {
        "type": TYPES[window.type_index],
        "region": region,
        "frame": "mana/map",
        "t0": str(window.first_s * S),
        "t1": str(window.last_s * S),
    }


def syncs(directory: Path) -> Figures:
    """Return the times of fsync of 4 kB."""
    with (directory / "sync").open("wb") as file:

        def sync() -> None:
            file.write(bytes(4096))
            file.flush()
            os.fsync(file.fileno())

        return timed([sync for _ in range(100)])


def file_system(directory: Path) -> str:
    """Return the type of the file system of a directory."""
    command = ["findmnt", "-n", "-o", "FSTYPE", "-T", str(directory)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Measure, print a table, and write JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--products", type=int, default=20_000)
    parser.add_argument(
        "--flat", default="2000", help="sizes of smaller stores to search too, separated by commas"
    )
    parser.add_argument("--searches", type=int, default=300)
    parser.add_argument("--access", action="store_true", help="also over HTTP and Zenoh")
    parser.add_argument("--dir", type=Path, default=None, help="where to write; the file system matters")
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--search-only", type=Path, default=None, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.search_only is not None:
        print(json.dumps(search_only(args.search_only, args.products, args.searches)))
        return
    with tempfile.TemporaryDirectory(dir=args.dir) as base:
        results: Figures = {}
        counts = sorted({args.products, *(int(n) for n in args.flat.split(",") if n)})
        for products in counts:
            for name, measure in (("raw", raw), ("store", measure_store)):
                directory = Path(base) / f"{name}-{products}"
                directory.mkdir()
                results[f"{name}, {products} products"] = show(
                    f"{name}, {products} products", measure(directory, products, args.searches)
                )
                if name == "raw":
                    shutil.rmtree(directory)
        if args.access:
            access_figures = access(Path(base) / f"store-{counts[-1]}", counts[-1], args.searches)
            results["service"] = show("service", access_figures)
        about = {
            "products": args.products,
            "payload_bytes": PAYLOAD_BYTES,
            "file_system": file_system(Path(base)),
            "sync_ms": syncs(Path(base))["p50_ms"],
            "sqlite": sqlite3.sqlite_version,
            "python": platform.python_version(),
            "cpus": os.cpu_count(),
            "load": os.getloadavg()[0],
        }
    show("about", about)
    if args.out is not None:
        args.out.write_text(json.dumps({"about": about, **results}, indent=2) + "\n")


def show(name: str, figures: Figures) -> Figures:
    """Print results, one operation per line, and return them."""
    for operation, result in figures.items():
        print(f"{name:22} {operation:14} {json.dumps(_rounded(result))}", flush=True)
    return figures


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return float(f"{value:.3g}") if isinstance(value, float) else value


if __name__ == "__main__":
    main()
