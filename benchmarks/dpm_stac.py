# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CPU time and size of pages of 100 items and features over HTTP, without the network.

    python benchmarks/dpm_stac.py [--products 3000] [--repeat 30] [--out FILE]

The products are DEMs on Mars with outlines of 24 corners and three inputs each, in 1 km x 1 km. A request is
sent to the application in this process; times are the smallest of several rounds, since other processes only
add to them.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.clock import ManualClock
from cdff_common.geodesy import Anchor, body
from cdff_common.interfaces.product import Header, product_id
from dpm_store import NewProduct, open_store
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

#: Nanoseconds in a second.
S = 1_000_000_000
BOX = "77.45,18.44,77.455,18.45"
REQUESTS = {
    "items in a box": f"/stac/search?collections=dem&bbox={BOX}",
    "items of a collection": "/stac/collections/dem/items",
    "items by a filter": "/stac/search?filter=gsd%3D0.1%20AND%20platform%3D'mana'",
    "items sorted": "/stac/search?sortby=gsd,id",
    "items with all fields": "/stac/search?fields=properties,links,assets",
    "features in a box": f"/ogc/collections/dem/items?bbox={BOX}&limit=100",
}


def products(count: int) -> list[NewProduct]:
    """Return DEMs with random outlines."""
    rng, new_products, ids = np.random.default_rng(0), [], []
    for i in range(count):
        x, y = rng.uniform(0.0, 1000.0, 2)
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 24))
        ring = np.column_stack([x + 5.0 + 4.9 * np.cos(angles), y + 5.0 + 4.9 * np.sin(angles)])
        header = Header(
            product_id("mana", "mapping", "dem", i * S, i, "c"),
            i,
            i * S,
            i * S,
            "site",
            "mapping/one/1",
            config_hash="c" * 16,
            box_m=(x, y, 0.0, x + 10.0, y + 10.0, 1.0),
            resolution_m=0.1,
            inputs=tuple(ids[-3:]),
            footprint_m=tuple(ring.ravel().tolist()),
        )
        ids.append(header.id)
        payload = os.urandom(100) + i.to_bytes(8, "big")
        new_products.append(NewProduct(header, payload, "mana", "mapping", "dem", "dem", "ElevationMap"))
    return new_products


async def get(app: Any, address: str) -> bytes:
    """Return the body of the answer to a GET request."""
    path, _, query = address.partition("?")
    parts: list[bytes] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Any) -> None:
        parts.append(message.get("body", b""))

    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": "GET",
        "path": path,
        "raw_path": path.encode(),
        "query_string": query.encode(),
        "headers": [(b"host", b"127.0.0.1:8080")],
        "scheme": "http",
        "server": ("127.0.0.1", 8080),
        "client": ("127.0.0.1", 1),
        "root_path": "",
    }
    await app(scope, receive, send)
    return b"".join(parts)


async def measure(app: Any, repeat: int) -> dict[str, dict[str, float]]:
    """Return CPU milliseconds of a page and bytes of an item for each kind of request."""
    results = {}
    for name, address in REQUESTS.items():
        data = json.loads(await get(app, address))
        best = float("inf")
        for _ in range(5):
            start = time.process_time()
            for _ in range(repeat // 5):
                text = await get(app, address)
            best = min(best, (time.process_time() - start) / (repeat // 5))
        count = len(data["features"])
        results[name] = {"cpu_ms": best * 1e3, "items": count, "bytes_of_item": len(text) / count}
    return results


def main() -> None:
    """Measure, print a table, and write JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--products", type=int, default=3000)
    parser.add_argument("--repeat", type=int, default=30)
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        open_store(f"sqlite:///{folder}", ManualClock(10**6 * S)) as store,
    ):
        store.anchors.anchor("site", Anchor(body("mars"), 77.45, 18.44))
        store.put_all(products(args.products))
        app = create_app(Context(Dpm(store, max_payload_bytes=1 << 20), Settings(Path(folder))))
        results = asyncio.run(measure(app, args.repeat))
    for name, figures in results.items():
        print(f"{name:24} " + "  ".join(f"{key} {value:.5g}" for key, value in figures.items()))
    if args.out is not None:
        about = {"products": args.products, "cpus": os.cpu_count(), "load": os.getloadavg()[0]}
        args.out.write_text(json.dumps({"about": about, **results}, indent=2) + "\n")


if __name__ == "__main__":
    main()
