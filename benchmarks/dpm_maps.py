# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure maps of a store: windows of 1000 x 1000 and 400 x 400 cells from 200 patches, and rendered tiles.

    python benchmarks/dpm_maps.py [--patches 200] [--side 128] [--trials 7] [--auxiliary] [--no-blocks]
        [--out FILE]

The patches (``--side`` cells of 5 cm along an edge, every cell observed) have random positions in the window;
with ``--auxiliary`` they have the auxiliary layers of ``digital_elevation_mapping`` too. For ``cold`` the
store is opened again, so that nothing is decoded or rendered yet. The payload files may be in the page cache;
disk times are not measured. The smaller window is also repeated, and repeated after the insertion of a patch.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report

from cdff_common.clock import ManualClock
from cdff_common.codecs import encode
from cdff_common.geometry.region import parse_region
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import ELEVATION_LAYERS, GridGeometry
from cdff_common.raster.tiles import Tile, level_of, tiles_over
from cdff_common.types import ElevationMap
from dpm_store import NewProduct, Store, open_store
from dpm_store.maps import pooled_blocks
from dpm_store.maps.windows import WindowQuery
from services.dpm.rendering.tiles import TileRequest, Tiles

#: Nanoseconds in a second.
S = 1_000_000_000
CELL_M = 0.05
SIDE_CELLS = 1000


def patch(rng: np.random.Generator, side: int, seq: int, auxiliary: bool) -> NewProduct:
    """Return a patch at a random position in the window, with smooth relief and noise."""
    left, bottom = (int(v) for v in rng.integers(0, SIDE_CELLS - side, 2))
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
    }
    t_ns = (seq + 1) * S
    named = {n: layers[n] for n in ELEVATION_LAYERS}
    if auxiliary:
        auxiliary_values = {
            "pose_variance": 4e-5,
            "error_variance": 5e-5,
            "first_age_s": 0.5,
            "intensity": 8.0,
            "overhang_m": 2.0,
        }
        named |= {n: np.full_like(mean, v) for n, v in auxiliary_values.items()}
    value = ElevationMap.from_layers(geometry, named, t0_ns=t_ns, t1_ns=t_ns)
    header = Header(
        id=product_id("mana", "dem", "map", t_ns, seq, "c"),
        seq=seq,
        t0_ns=t_ns,
        t1_ns=t_ns,
        frame="site",
        producer="benchmark",
        config_hash="c",
        box_m=value.extent_m(),
        resolution_m=CELL_M,
    )
    return NewProduct(
        header,
        encode(value, "uper"),
        "mana",
        "digital_elevation_mapping",
        "map",
        "dem",
        "ElevationMap",
        "uper",
        value,
    )


def timed(call: Callable[[], object], trials: int) -> dict[str, float]:
    """Return milliseconds: median and minimum of wall time, median of CPU time."""
    walls, cpus = [], []
    for _ in range(trials):
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        cpus.append((time.process_time() - cpu) * 1e3)
        walls.append((time.perf_counter() - wall) * 1e3)
    return {
        "p50_ms": round(statistics.median(walls), 3),
        "least_ms": round(min(walls), 3),
        "cpu_ms": round(statistics.median(cpus), 3),
    }


def window(url: str, trials: int) -> dict[str, Any]:
    """Return the times of the whole window, in a store just opened and in one already used."""
    query = WindowQuery(parse_region(f"bbox:0,0,{SIDE_CELLS * CELL_M},{SIDE_CELLS * CELL_M}"))

    def cold() -> None:
        with open_store(url) as store:
            store.search()  # opens the connections
            spans.append(timed(lambda: store.maps.elevation_window(query), 1))

    spans: list[dict[str, float]] = []
    for _ in range(trials + 1):  # the first call compiles the kernels
        cold()
    del spans[0]
    with open_store(url) as store:
        store.maps.elevation_window(query)
        warm = timed(lambda: store.maps.elevation_window(query), trials)
        elevation = store.maps.elevation_window(query)
    cold_medians = {name: round(statistics.median(s[name] for s in spans), 3) for name in spans[0]}
    return {
        "patches": len(elevation.patches),
        "coverage": elevation.coverage,
        "cold": cold_medians,
        "warm": warm,
    }


def repeated_window(url: str, side: int, auxiliary: bool, trials: int) -> dict[str, Any]:
    """Return the durations of a request for a window in the middle: of the first request, of repeated ones,
    and of one after an insertion.
    """
    edge_m = np.array([0.3, 0.7]) * SIDE_CELLS * CELL_M
    query = WindowQuery(parse_region(f"bbox:{edge_m[0]},{edge_m[0]},{edge_m[1]},{edge_m[1]}"))
    rng = np.random.default_rng(2)

    def assemble(store: Store) -> dict[str, float]:
        return timed(lambda: store.maps.elevation_window(query), 1)

    with open_store(url, ManualClock(S)) as store:
        store.search()
        first, patches = assemble(store), len(store.maps.elevation_window(query).patches)
        repeated = timed(lambda: store.maps.elevation_window(query), trials)
        inserted = []
        for seq in range(10_000, 10_000 + trials):
            store.put_all([patch(rng, side, seq, auxiliary)])
            inserted.append(assemble(store))
    medians = {name: round(statistics.median(s[name] for s in inserted), 3) for name in inserted[0]}
    return {"patches": patches, "first": first, "repeated": repeated, "after_insertion": medians}


def tiles(url: str) -> dict[str, Any]:
    """Return the times of all tiles at the level of the patches, and of four overviews.

    ``first``: the patches have not been read before. ``cold``: the rendering is not cached. ``warm``: the
    rendering is cached. ``overview_first`` includes the aggregation of the finer levels.
    """
    level = level_of(CELL_M)
    side = (1.0, 1.0, SIDE_CELLS * CELL_M - 1.0, SIDE_CELLS * CELL_M - 1.0)
    columns, rows = tiles_over(level, side)
    patch_tiles = [Tile(level, x, y) for x in columns for y in rows]
    for _ in range(2):  # the first run compiles kernels
        with open_store(url) as store:
            store.search()
            rendered = Tiles(store)
            first = [
                timed(partial(rendered.get, TileRequest("site", "hillshade", tile)), 1)
                for tile in patch_tiles
            ]
            uncached = [
                timed(partial(rendered.get, TileRequest("site", "slope", tile)), 1) for tile in patch_tiles
            ]
            warm = [
                timed(partial(rendered.get, TileRequest("site", "slope", tile)), 20) for tile in patch_tiles
            ]
            overview_tiles = [
                Tile(z, *(r[0] for r in tiles_over(z, side))) for z in (level - 1, level - 3, level - 8, 0)
            ]
            overview = [
                timed(partial(rendered.get, TileRequest("site", "hillshade", tile)), 1)
                for tile in overview_tiles
            ]
            overview_uncached = [
                timed(partial(rendered.get, TileRequest("site", "slope", tile)), 1) for tile in overview_tiles
            ]

    def medians(spans: list[dict[str, float]]) -> dict[str, float]:
        return {name: round(statistics.median(s[name] for s in spans), 3) for name in ("p50_ms", "cpu_ms")}

    return {
        "tiles": len(patch_tiles),
        "first": medians(first),
        "cold": medians(uncached),
        "warm": medians(warm),
        "overview_first": medians(overview),
        "overview_cold": medians(overview_uncached),
    }


def fill_store(url: str, patches: int, side: int, auxiliary: bool) -> None:
    """Insert the patches into a new store."""
    rng = np.random.default_rng(1)
    with open_store(url, ManualClock(S)) as store:
        store.put_all([patch(rng, side, seq, auxiliary) for seq in range(patches)])


def main() -> int:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--patches", type=int, default=200)
    parser.add_argument("--side", type=int, default=128)
    parser.add_argument("--trials", type=int, default=7)
    parser.add_argument("--no-blocks", action="store_true", help="assemble every window from its patches")
    parser.add_argument("--auxiliary", action="store_true", help="patches with auxiliary layers")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    if args.no_blocks:
        pooled_blocks.WINDOW_BYTES = 0
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{folder}/data"
        fill_store(url, args.patches, args.side, args.auxiliary)
        figures = {
            "machine": {"cpu_count": os.cpu_count(), "python": platform.python_version()},
            "patches": {
                "count": args.patches,
                "side_cells": args.side,
                "cell_m": CELL_M,
                "auxiliary": args.auxiliary,
            },
            "window_1000x1000": window(url, args.trials),
            "tile_256x256": tiles(url),
            "window_400x400": repeated_window(url, args.side, args.auxiliary, args.trials),
        }
    write_report(figures, args.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
