# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare searches and tiles of the DPM with stac-fastapi-pgstac and titiler, in one run on one machine.

    scripts/peers --servers
    python benchmarks/dpm_peers.py [--items 3000] [--requests 40] [--rounds 3] [--out FILE]

The peers know only the Earth, so that the site is anchored there. stac-fastapi-pgstac has the items that the
DPM serves, in PostgreSQL with PostGIS and default settings; titiler renders tiles of the same map, which the
DPM exports as a cloud-optimised GeoTIFF. Each server is one process with one worker; PostgreSQL has its own
processes. A request is sent to one server and then to the other, with the same parameters; both must return
the same items. Milliseconds are medians over the requests of the wall time, and the mean CPU time of the
processes of a server. ``ratio`` is that of the DPM to that of the peer.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

import dpm_maps
import dpm_stac
import numpy as np
import psutil
from _report import write_report
from _services import Services

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, body
from cdff_common.raster.tiles import level_of, tiles_over
from cdff_dev.ports import free_port
from dpm_store import open_store
from evaluation.peers.postgresql import PostgreSQL, binaries

ROOT = Path(__file__).resolve().parent.parent
LON_DEG, LAT_DEG = 1.48, 43.56
#: Nanoseconds in a second.
S = 1_000_000_000
COLLECTION = "pointcloud"
#: Sides of the boxes of the searches, degrees: each selects about 10 and 100 of 3 000 items.
SMALL_DEG, LARGE_DEG = 0.0007, 0.0022
#: Resolution of a tile of Web Mercator at level 0 on the equator, metres.
_MERCATOR_M = 156_543.03
Figures = dict[str, Any]


class Server:
    """Address and processes of a server."""

    def __init__(self, url: str, pids: Sequence[int]) -> None:
        self.url, self._pids = url, pids

    def cpu_s(self) -> float:
        """Return the CPU time of its processes and their children, also of ended ones."""
        total = 0.0
        for pid in self._pids:
            process = psutil.Process(pid)
            times = process.cpu_times()
            total += times.user + times.system + times.children_user + times.children_system
            for child in process.children(recursive=True):
                times = child.cpu_times()
                total += times.user + times.system
        return total

    def get(self, path: str) -> bytes:
        """Return the body of the answer to a GET request."""
        with urllib.request.urlopen(self.url + path, timeout=60) as answer:
            return bytes(answer.read())


def fill(directory: Path, items: int) -> None:
    """Insert products with outlines, and patches of a map, on a site on the Earth."""
    rng = np.random.default_rng(1)
    with open_store(f"sqlite:///{directory}", ManualClock((items + 10_000) * S)) as store:
        store.anchors.anchor("site", Anchor(body("earth"), LON_DEG, LAT_DEG))
        store.put_all(
            [replace(p, product=COLLECTION, type_name="Pointcloud") for p in dpm_stac.products(items)]
        )
        for seq in range(200):
            store.put_all([dpm_maps.patch(rng, 128, seq, False)])


@contextmanager
def peer(python: Path, application: str, environment: dict[str, str], log: Path) -> Iterator[tuple[str, int]]:
    """Serve an ASGI application with one worker; yield its address and process."""
    port = free_port()
    command = [str(python), "-m", "uvicorn", application, "--port", str(port), "--log-level", "warning"]
    with (
        log.open("ab") as file,
        subprocess.Popen(command, env=os.environ | environment, stdout=file, stderr=file) as process,
    ):
        url = f"http://127.0.0.1:{port}"
        try:
            until_s = time.monotonic() + 120.0
            while not _answers(url):
                if time.monotonic() > until_s or process.poll() is not None:
                    raise TimeoutError(f"{application} does not answer: {log.read_text()[-2000:]}")
                time.sleep(0.3)
            yield url, process.pid
        finally:
            process.terminate()


def _answers(url: str) -> bool:
    """Return whether a server answers, with any status."""
    try:
        urllib.request.urlopen(url, timeout=5.0).read()
    except OSError as error:
        return isinstance(error, urllib.error.HTTPError)
    return True


def load_pgstac(python: Path, dsn: str, ours: Server, folder: Path) -> int:
    """Load the items of the DPM into pgstac; return their number."""
    tool = python.with_name("pypgstac")
    collection = json.loads(ours.get(f"/stac/collections/{COLLECTION}"))
    (folder / "collection.ndjson").write_text(json.dumps(collection) + "\n", encoding="utf-8")
    path, count = f"/stac/search?collections={COLLECTION}&limit=1000", 0
    with (folder / "items.ndjson").open("w", encoding="utf-8") as file:
        while path:
            page = json.loads(ours.get(path))
            for item in page["features"]:
                file.write(json.dumps(item) + "\n")
                count += 1
            path = next((li["href"] for li in page["links"] if li["rel"] == "next"), "").removeprefix(
                ours.url
            )
    for arguments in (
        ("migrate",),
        ("load", "collections", str(folder / "collection.ndjson"), "--method", "upsert"),
        ("load", "items", str(folder / "items.ndjson"), "--method", "insert"),
    ):
        subprocess.run([str(tool), *arguments, "--dsn", dsn], check=True, stdout=subprocess.DEVNULL)
    return count


def searches(ids: Sequence[str], times: Sequence[str], count: int) -> dict[str, list[str]]:
    """Return ``count`` different requests of each kind, without the part of the path of the server."""
    rng = np.random.default_rng(2)
    span_deg = 1000.0 / 111_000.0  # of the area of 1 km

    def box(side: float) -> str:
        x = LON_DEG + rng.uniform(0.0, span_deg / math.cos(math.radians(LAT_DEG)) - side)
        y = LAT_DEG + rng.uniform(0.0, span_deg - side)
        return f"{x:.6f},{y:.6f},{x + side:.6f},{y + side:.6f}"

    def interval() -> str:
        first = int(rng.integers(0, len(times) - len(times) // 10))
        return f"{times[first]}/{times[first + len(times) // 10 - 1]}"

    def search(**parameters: str) -> str:
        return f"/search?{urlencode({'collections': COLLECTION, 'limit': '100', **parameters})}"

    def condition() -> str:
        start = times[int(rng.integers(len(times)))]
        return f"gsd <= 0.2 AND platform = 'mana' AND datetime >= TIMESTAMP('{start}')"

    makers = {
        "small box": lambda: search(bbox=box(SMALL_DEG)),
        "large box": lambda: search(bbox=box(LARGE_DEG)),
        "interval": lambda: search(datetime=interval()),
        "box and interval": lambda: search(bbox=box(LARGE_DEG), datetime=interval()),
        "filter": lambda: search(filter=condition(), **{"filter-lang": "cql2-text"}),
        "order": lambda: search(datetime=interval(), sortby="+datetime"),
        "one item": lambda: f"/collections/{COLLECTION}/items/{ids[int(rng.integers(len(ids)))]}",
    }
    return {name: [make() for _ in range(count)] for name, make in makers.items()}


def compare(
    ours: Server, theirs: Server, pairs: Sequence[tuple[str, str]], rounds: int, equal: Any = None
) -> Figures:
    """Return the times of pairs of requests to both servers; ``equal`` compares two answers."""
    walls: tuple[list[float], list[float]] = ([], [])
    cpu_s, calls = [0.0, 0.0], 0
    for number in range(rounds):
        answers: list[list[bytes]] = [[], []]
        for index in ((0, 1), (1, 0))[number % 2]:
            server = (ours, theirs)[index]
            start_cpu_s = server.cpu_s()
            for pair in pairs:
                start_s = time.perf_counter()
                answers[index].append(server.get(pair[index]))
                walls[index].append(time.perf_counter() - start_s)
            cpu_s[index] += server.cpu_s() - start_cpu_s
        calls += len(pairs)
        if equal is not None and not number:
            for pair, one, other in zip(pairs, *answers, strict=True):
                assert equal(one, other), f"different answers: {pair}"
    wall_ms = [statistics.median(w) * 1e3 for w in walls]
    cpu_ms = [total / calls * 1e3 for total in cpu_s]
    return {
        "wall_ms": [round(v, 2) for v in wall_ms],
        "cpu_ms": [round(v, 2) for v in cpu_ms],
        "wall_ratio": round(wall_ms[0] / wall_ms[1], 3),
        "cpu_ratio": round(cpu_ms[0] / cpu_ms[1], 3),
    }


def same_items(one: bytes, other: bytes) -> bool:
    """Return whether two answers have the same items; of a search with more than a page, equally many."""
    ids = [{f["id"] for f in data.get("features", [data])} for data in map(json.loads, (one, other))]
    return ids[0] == ids[1] or len(ids[0]) == len(ids[1]) == 100


def tiles(cog: Path, step: int) -> list[tuple[str, str]]:
    """Return requests of tiles with the same size on the ground: of the DPM, and of titiler.

    ``step`` is the number of levels above the finest one.
    """
    z = level_of(dpm_maps.CELL_M) - step
    side_m = dpm_maps.SIDE_CELLS * dpm_maps.CELL_M
    columns, rows = tiles_over(z, (0.5, 0.5, side_m - 0.5, side_m - 0.5))
    ours = [f"/tiles/dem/{z}/{x}/{y}.png?low=-2&high=2" for y in rows for x in columns]
    mercator = round(math.log2(_MERCATOR_M * math.cos(math.radians(LAT_DEG)) / dpm_maps.CELL_M)) - step

    def index(lon_deg: float, lat_deg: float) -> tuple[int, int]:
        y = (1.0 - math.asinh(math.tan(math.radians(lat_deg))) / math.pi) / 2.0
        return int((lon_deg + 180.0) / 360.0 * (1 << mercator)), int(y * (1 << mercator))

    height_deg = side_m / 111_132.0
    left, bottom = index(LON_DEG, LAT_DEG)
    right, top = index(LON_DEG + height_deg / math.cos(math.radians(LAT_DEG)), LAT_DEG + height_deg)
    query = f"url={quote(str(cog))}&bidx=1&rescale=-2,2&colormap_name=viridis"
    theirs = [
        f"/cog/tiles/WebMercatorQuad/{mercator}/{x}/{y}.png?{query}"
        for y in range(top, bottom + 1)
        for x in range(left, right + 1)
    ]
    count = min(len(ours), len(theirs))
    return list(zip(ours[:count], theirs[:count], strict=True))


def main() -> None:
    """Start the servers, compare, and write JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--items", type=int, default=3000)
    parser.add_argument("--requests", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--peers", type=Path, default=ROOT / "build" / "dpm-servers")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    python = args.peers / "bin" / "python"
    if not python.exists() or binaries() is None:
        raise SystemExit(
            "no PostgreSQL, psycopg or peers: run scripts/setup evaluate; scripts/peers --servers"
        )
    with tempfile.TemporaryDirectory() as name:
        report = run(Path(name), python, args)
    write_report(report, args.out)


def run(folder: Path, python: Path, args: argparse.Namespace) -> Figures:
    """Return the figures of searches and tiles."""
    fill(folder / "data", args.items)
    port = free_port()
    database = PostgreSQL(folder / "postgresql")
    with (folder / "postgresql/data/postgresql.conf").open("a") as configuration:
        configuration.write(f"listen_addresses = '127.0.0.1'\nport = {port}\n")
    database.start()
    try:
        postmaster = int((folder / "postgresql/data/postmaster.pid").read_text().splitlines()[0])
        environment = {
            "PGUSER": "cdff",
            "PGPASSWORD": "-",
            "PGHOST": "127.0.0.1",
            "PGPORT": str(port),
            "PGDATABASE": "postgres",
        }
        with Services(folder) as services:
            ours = Server(services.http, [services.dpm.pid])
            dsn = f"postgresql://cdff@127.0.0.1:{port}/postgres"
            count = load_pgstac(python, dsn, ours, folder)
            lines = (folder / "items.ndjson").read_text(encoding="utf-8").splitlines()
            items = [
                item
                for item in map(json.loads, lines)
                if item["properties"]["instruments"] == ["mapping/dem"]
            ]
            times = sorted(item["properties"]["datetime"] for item in items)
            kinds = searches([item["id"] for item in items], times, args.requests)
            figures: Figures = {"items": count, "order": "DPM, peer", "searches": {}, "tiles": {}}
            log = folder / "peers.log"
            application = "stac_fastapi.pgstac.app:create_app"
            with peer(python, application, environment, log) as (url, pid):
                theirs = Server(url, [pid, postmaster])
                for kind, paths in kinds.items():
                    pairs = [(f"/stac{path}", path) for path in paths]
                    figures["searches"][kind] = compare(ours, theirs, pairs, args.rounds, same_items)
            cog = folder / "map.tif"
            side_m = dpm_maps.SIDE_CELLS * dpm_maps.CELL_M
            cog.write_bytes(ours.get(f"/api/v1/maps/dem/window?region=bbox:0,0,{side_m},{side_m}&format=tif"))
            with peer(python, "titiler.application.main:app", {}, log) as (url, pid):
                theirs = Server(url, [pid])
                for step in (0, 2):
                    pairs = tiles(cog, step)
                    kind = "finest level" if step == 0 else f"{step} levels above"
                    first = compare(ours, theirs, pairs, 1)
                    figures["tiles"][kind] = {"count": len(pairs), "first": first}
                    figures["tiles"][kind]["again"] = compare(ours, theirs, pairs, args.rounds)
    finally:
        database.stop("fast")
    return figures


if __name__ == "__main__":
    main()
