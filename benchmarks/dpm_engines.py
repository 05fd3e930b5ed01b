# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The store on SQLite, on PostgreSQL with PostGIS, and with payloads in an object store, in one run.

Insertions in batches and one by one, and searches of each shape of ``benchmarks/dpm.py``, by one client. The
servers are started here (``make peers``) and sync their commits.

    python benchmarks/dpm_engines.py [--products N] [--searches N] [--engines sqlite,postgresql,postgresql+s3]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]

from dpm import BATCH, PAYLOAD_BYTES, Figures, boxes, fill, products_of, searches, show, timed  # noqa: E402

from cdff_common.clock import ManualClock  # noqa: E402
from dpm_store import open_store  # noqa: E402
from tests.support import postgresql, seaweedfs  # noqa: E402

_SINGLES = 200


def measure(url: str, products: int, search_count: int) -> Figures:
    """Return the figures of one store."""
    with open_store(url, ManualClock(1_000_000_000)) as store:
        figures: Figures = {"bulk": fill(store, products)}
        singles = products_of(products + 1000, list(boxes(_SINGLES)), os.urandom(PAYLOAD_BYTES - 8))
        figures["insert"] = timed([lambda p=p: store.put_all((p,)) for p in singles])  # type: ignore[misc]
        return figures | searches(store, products, search_count)


def main() -> None:
    """Measure, print a table, and write JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--products", type=int, default=100_000)
    parser.add_argument("--searches", type=int, default=300)
    parser.add_argument("--engines", default="sqlite,postgresql,postgresql+s3")
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    results: Figures = {"about": {"products": args.products, "batch": BATCH, "cpus": os.cpu_count()}}
    with tempfile.TemporaryDirectory() as base, ExitStack() as exit_stack:
        for number, engine in enumerate(args.engines.split(",")):
            directory, payloads = Path(base) / str(number), ""
            url = f"sqlite:///{directory}"
            if engine.endswith("+s3"):
                exit_stack.enter_context(seaweedfs.object_server())
                payloads = f"s3://{seaweedfs.BUCKET}/{number}"
            if engine != "sqlite":
                cluster = exit_stack.enter_context(postgresql.cluster())
                cluster.execute("CREATE DATABASE store")
                url = cluster.url("store", directory, payloads)
            results[engine] = show(engine, measure(url, args.products, args.searches))
        results["about"]["load"] = os.getloadavg()[0]
    show("about", results["about"])
    if args.out is not None:
        args.out.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
