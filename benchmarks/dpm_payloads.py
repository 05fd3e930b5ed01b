# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Size of the payload files of a store, and the time to write and read them, compressed and as they are.

    cdff demo --once --data-dir DIR
    python benchmarks/dpm_payloads.py DIR [--count 200] [--out FILE]

``compressed`` is ``dpm_store.payloads.blobs.BlobFiles``. ``plain`` writes the payload itself with the same
calls: temporary file, fsync, rename, fsync of the folder. Both write below ``DIR`` and remove their files;
they take turns with each payload. Reading includes the comparison with the checksums; files are in the page
cache. Times are medians per payload, wall and CPU, by product.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from _report import write_report

from cdff_common.clock import ManualClock
from dpm_store import Query, open_store
from dpm_store.payloads.blobs import BlobFiles, check_chunks, chunk_sums, digest, fsync
from dpm_store.payloads.payloads import PACKED_BYTES

Times = dict[str, list[tuple[float, float]]]


def timed(call: Callable[[], Any], times: list[tuple[float, float]]) -> Any:
    """Return the result of a call and add its wall and CPU time, milliseconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = call()
    times.append(((time.perf_counter() - wall) * 1e3, (time.process_time() - cpu) * 1e3))
    return result


def write_plain(path: Path, payload: bytes) -> None:
    """Write a payload durably, as it is."""
    path.parent.mkdir(exist_ok=True)
    descriptor, temporary = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(descriptor, "wb") as file:
        file.write(payload)
        file.flush()
        os.fsync(file.fileno())
    Path(temporary).rename(path)
    fsync(path.parent)


def read_plain(path: Path, sums: bytes) -> bytes:
    """Read a payload and compare it with its checksums."""
    data = path.read_bytes()
    check_chunks(data, 0, sums, path.name)
    return data


def measured(store_folder: Path, count: int) -> dict[str, Any]:
    """Return sizes and times of the newest ``count`` payloads of each product."""
    times: dict[str, Times] = defaultdict(lambda: defaultdict(list))
    sizes: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    with (
        open_store(f"sqlite:///{store_folder}", ManualClock(0)) as store,
        tempfile.TemporaryDirectory(dir=store_folder) as folder,
    ):
        files, plain = BlobFiles(Path(folder) / "compressed"), Path(folder) / "plain"
        plain.mkdir()
        for product in sorted({product for _, product in store.statistics().products}):
            for record in store.search(Query(types=(product,), limit=count)).items:
                payload = store.payload(record.id)
                if len(payload) <= PACKED_BYTES:
                    continue
                sums, name, of = chunk_sums(payload), digest(payload), times[product]
                path = plain / name
                timed(lambda p=payload, n=name, s=sums: files.write(n, p, s), of["write_compressed"])
                timed(lambda p=payload, t=path: write_plain(t, p), of["write_plain"])
                read = timed(
                    lambda p=payload, n=name, s=sums: files.read(n, len(p), s, 0, len(p), n),
                    of["read_compressed"],
                )
                if (
                    read != payload
                    or timed(lambda t=path, s=sums: read_plain(t, s), of["read_plain"]) != read
                ):
                    raise SystemExit(f"{product} {record.id}: the payload read differs from that written")
                total = sizes[product]
                total[0] += 1
                total[1] += len(payload)
                total[2] += files.path(name).stat().st_size
                files.remove(name)
                path.unlink()
    return {
        product: {
            "payloads": n,
            "mb": round(plain_bytes / 1e6, 3),
            "compressed_mb": round(compressed_bytes / 1e6, 3),
            "mb_each": round(plain_bytes / n / 1e6, 3),
            "compressed_mb_each": round(compressed_bytes / n / 1e6, 3),
        }
        | {
            f"{name}_{kind}_ms": round(statistics.median(row[i] for row in rows), 3)
            for name, rows in times[product].items()
            for i, kind in enumerate(("wall", "cpu"))
        }
        for product, (n, plain_bytes, compressed_bytes) in sizes.items()
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("store", type=Path, help="data directory of a DPM that is not running")
    parser.add_argument("--count", type=int, default=200, help="payloads of each product, the newest ones")
    parser.add_argument("--out", type=Path, help="file for the results; printed if absent")
    args = parser.parse_args()
    products = measured(args.store, args.count)
    totals = {key: round(sum(row[key] for row in products.values()), 3) for key in ("mb", "compressed_mb")}
    write_report({"products": products, "total": totals}, args.out)


if __name__ == "__main__":
    main()
