# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the memory of a DPM process under three loads, each with a new process.

    python benchmarks/dpm_memory.py [--load large|serial|ordinary ...] [--minutes 10] [--out FILE]

- ``large``: 24 simultaneous GETs of an elevation window of 4 million cells, each repeated after 503 at most
  ten times with the requested pause.
- ``serial``: 12 windows of about 100 x 100 cells, one after the other, each over other patches of 1400 x 1400
  cells.
- ``ordinary``: minutes of insertions, searches, tiles, windows, clouds and conversions by four clients;
  ``--load ordinary --minutes 120`` is a soak, with the slopes of memory, descriptors and threads per hour.

The memory is the resident set: at the start (after one small window), the highest, and ten seconds after the
load.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report
from _services import PeakMemory, Services, fetch, memory_mb

from cdff_common.codecs import encode
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, Pointcloud

S = 1_000_000_000
CELL_M = 0.05
#: Cells along an edge of a large patch.
LARGE = 1400
_SETTLE_S = 10.0


def elevation(rng: np.random.Generator, left: int, bottom: int, side: int, t_ns: int) -> ElevationMap:
    """Return a patch of smooth relief with noise, every cell observed; with auxiliary layers."""
    geometry = GridGeometry.from_cells("site", CELL_M, left=left, top=bottom + side, rows=side, cols=side)
    x, y = geometry.centres_m()
    mean = (np.sin(x / 3.0) * np.cos(y / 4.0) + rng.normal(0.0, 0.01, x.shape)).astype(np.float32)
    layers = {
        "mean": mean,
        "variance": np.full_like(mean, 1e-4),
        "min": mean - 0.02,
        "max": mean + 0.02,
        "count": np.full_like(mean, 5.0),
        "age_s": np.zeros_like(mean),
        "pose_variance": np.full_like(mean, 4e-5),
        "error_variance": np.full_like(mean, 5e-5),
    }
    return ElevationMap.from_layers(geometry, layers, t0_ns=t_ns, t1_ns=t_ns)


def put(http: str, value: Any, product: str, type_name: str, seq: int, resolution_m: float | None) -> str:
    """Insert a product over HTTP and return its id."""
    t_ns = int(time.time()) * S - seq * 1000
    header = Header(
        id=product_id("mana", "load", product, t_ns, seq, "c"),
        seq=seq,
        t0_ns=t_ns,
        t1_ns=t_ns,
        frame="site",
        producer="benchmark",
        config_hash="c",
        box_m=value.extent_m(),
        resolution_m=resolution_m,
    )
    url = f"{http}/api/v1/products?robot=mana&dfpc=load&port={product}&product={product}"
    headers = {
        "Content-Type": f"application/vnd.cdff+uper;{type_name}/1",
        "CDFF-Header": json.dumps(header.to_dict()),
    }
    call = urllib.request.Request(url, encode(value, "uper"), headers, method="POST")
    with urllib.request.urlopen(call, timeout=120) as answer:
        return str(json.load(answer)["id"])


def window_url(http: str, left: float, bottom: float, side_m: float, form: str = "tif") -> str:
    """Return the address of a square elevation window."""
    box = ",".join(f"{v:.3f}" for v in (left, bottom, left + side_m, bottom + side_m))
    return f"{http}/api/v1/maps/dem/window?region=bbox:{box}&resolution_m={CELL_M}&format={form}"


def large(http: str, load: Callable[[Callable[[], Any]], dict[str, Any]]) -> dict[str, Any]:
    """Ask for a window of 4 million cells 24 times at once."""
    rng = np.random.default_rng(0)
    for seq in range(25):
        patch = elevation(rng, seq % 5 * 400, seq // 5 * 400, 400, S)
        put(http, patch, "dem", "ElevationMap", seq, CELL_M)
    statuses: Counter[int] = Counter()

    def one() -> None:
        for _ in range(10):
            status, _size = fetch(window_url(http, 0.0, 0.0, 2000 * CELL_M))
            statuses[status] += 1
            if status != 503:
                return
            time.sleep(3.0)

    def all_at_once() -> None:
        clients = [threading.Thread(target=one) for _ in range(24)]
        for client in clients:
            client.start()
        for client in clients:
            client.join()

    return load(all_at_once) | {"statuses": dict(statuses)}


def serial(http: str, load: Callable[[Callable[[], Any]], dict[str, Any]]) -> dict[str, Any]:
    """Ask for small windows, each over four other large patches."""
    rng = np.random.default_rng(0)
    for seq in range(48):
        put(http, elevation(rng, seq // 4 * LARGE, 0, LARGE, S), "dem", "ElevationMap", seq, CELL_M)
    statuses: Counter[int] = Counter()

    def one_by_one() -> None:
        for i in range(12):
            left = (i * LARGE + LARGE // 2) * CELL_M
            statuses[fetch(window_url(http, left, 10.0, 5.0))[0]] += 1

    return load(one_by_one) | {"statuses": dict(statuses)}


def ordinary(
    http: str, load: Callable[[Callable[[], Any]], dict[str, Any]], minutes: float
) -> dict[str, Any]:
    """Insert maps and clouds, and read them in all forms."""
    statuses: Counter[int] = Counter()
    until_s: list[float] = []
    lock = threading.Lock()
    sequence = iter(range(1_000_000))
    ids: list[str] = []

    def insert(rng: np.random.Generator) -> None:
        with lock:
            seq = next(sequence)
        left, bottom = (int(v) for v in rng.integers(-1000, 1000, 2))
        if seq % 3:
            patch = elevation(rng, left, bottom, 300, S)
            product = put(http, patch, "dem", "ElevationMap", seq, CELL_M)
        else:
            points = rng.uniform(-20.0, 20.0, (60_000, 3))
            cloud = Pointcloud.from_points(points, frame="site", stamp_ns=seq * S)
            product = put(http, cloud, "pointcloud", "Pointcloud", seq, None)
        ids.append(product)

    def read(rng: random.Random) -> None:
        x, y, side_m = rng.uniform(-40, 20), rng.uniform(-40, 20), rng.choice((5.0, 20.0, 50.0))
        form = rng.choice(("tif", "png", "uper", "npz"))
        urls = (
            window_url(http, x, y, side_m, "tif" if form == "npz" else form),
            f"{http}/api/v1/maps/slope/window?region=bbox:{x:.2f},{y:.2f},{x + 20:.2f},{y + 20:.2f}",
            f"{http}/api/v1/maps/pointcloud/window?region=circle:{x:.2f},{y:.2f},15&points=200000",
            f"{http}/api/v1/products?type=dem&limit=100",
            f"{http}/api/v1/products/{rng.choice(ids)}/payload",
            f"{http}/api/v1/products/{rng.choice(ids)}/payload?format=npz",
            f"{http}/api/v1/products/{rng.choice(ids)}/thumbnail.png",
            f"{http}/tiles/dem/12/{rng.randrange(2044, 2052)}/{rng.randrange(2044, 2052)}.png",
            f"{http}/tiles/slope/10/{rng.randrange(511, 513)}/{rng.randrange(511, 513)}.png",
        )
        status, _ = fetch(rng.choice(urls))
        with lock:
            statuses[status] += 1

    def client(number: int) -> None:
        arrays, choice = np.random.default_rng(number), random.Random(number)
        while time.monotonic() < until_s[0]:
            try:
                if number == 0:
                    insert(arrays)
                    time.sleep(0.5)
                else:
                    read(choice)
            except urllib.error.HTTPError as error:
                with lock:
                    statuses[error.code] += 1

    def work() -> None:
        until_s.append(time.monotonic() + 60.0 * minutes)
        clients = [threading.Thread(target=client, args=(number,)) for number in range(4)]
        for thread in clients:
            thread.start()
        for thread in clients:
            thread.join()

    rng = np.random.default_rng(9)
    for _ in range(10):
        insert(rng)
    return load(work) | {"statuses": dict(statuses), "products": len(ids), "minutes": minutes}


def measured(pid: int, http: str, work: Callable[[], Any]) -> dict[str, Any]:
    """Run a load and return the memory of the process, MB."""
    fetch(window_url(http, 0.0, 0.0, 2.0))
    start_mb = memory_mb(pid)
    start_s = time.monotonic()
    with PeakMemory(pid) as peak:
        work()
    duration_s = time.monotonic() - start_s
    time.sleep(_SETTLE_S)
    return {
        "start_mb": start_mb,
        "peak_mb": peak.peak_mb,
        "after_mb": memory_mb(pid),
        "slopes_per_hour": peak.slopes_per_hour(),
        "duration_s": round(duration_s, 1),
    }


def main() -> None:
    """Run the loads and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = ("large", "serial", "ordinary")
    parser.add_argument("--load", choices=names, action="append")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report: dict[str, Any] = {}
    for name in args.load or names:
        with tempfile.TemporaryDirectory() as folder, Services(Path(folder)) as services:
            pid, http = services.dpm.pid, services.http

            def load(work: Callable[[], Any], pid: int = pid, http: str = http) -> dict[str, Any]:
                return measured(pid, http, work)

            if name == "ordinary":
                report[name] = ordinary(http, load, args.minutes)
            else:
                report[name] = {"large": large, "serial": serial}[name](http, load)
    write_report(report, args.out)


if __name__ == "__main__":
    main()
