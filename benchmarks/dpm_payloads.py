# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Size of the payload files of a store, and the time to insert and read products, as stored and plain.

    cdff demo --once --data-dir DIR
    python benchmarks/dpm_payloads.py DIR [--count 200] [--out FILE]

``stored`` is what the DPM and its clients do: ``cdff_common.codecs`` encodes the value, maps in their
compact form; the payload is hashed and ``dpm_store.payloads.blobs.BlobFiles`` writes it durably, compressed
if this saves space. ``encoded_mb_each`` is the size of the payload before this compression. ``plain`` encodes
whole layers and writes the payload as it is with the same calls: checksums, temporary file, fsync, rename,
fsync of the folder. Both take turns with each product, write below ``DIR`` and remove their files. Reading
includes the comparison with the checksums and the decoding; files are in the page cache. Times are medians
per product, wall and CPU, by type of product.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from _report import write_report

from cdff_common.clock import ManualClock
from cdff_common.codecs import MODULES, decode, encode
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
    sizes: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0, 0])
    with (
        open_store(f"sqlite:///{store_folder}", ManualClock(0)) as store,
        tempfile.TemporaryDirectory(dir=store_folder) as folder,
    ):
        files, plain_folder = BlobFiles(Path(folder) / "stored"), Path(folder) / "plain"
        plain_folder.mkdir()
        for product in sorted({product for _, product in store.statistics().products}):
            for record in store.search(Query(types=(product,), limit=count)).items:
                if record.size <= PACKED_BYTES:
                    continue
                type_name, codec, of = record.type_name, record.codec, times[product]
                value = decode(type_name, store.payload(record.id), codec)
                whole = import_module(f"cdff_common.codecs.{MODULES.get(codec, codec)}")
                path = plain_folder / record.sha256

                def insert_stored(value: Any = value, codec: str = codec) -> tuple[str, bytes, int]:
                    payload = encode(value, codec)
                    name, sums = digest(payload), chunk_sums(payload)
                    files.write(name, payload, sums)
                    return name, sums, len(payload)

                def insert_plain(value: Any = value, whole: Any = whole, path: Path = path) -> bytes:
                    payload = whole.encode(value)
                    digest(payload)
                    write_plain(path, payload)
                    return chunk_sums(payload)

                name, sums, size = timed(insert_stored, of["insert_stored"])
                plain_sums = timed(insert_plain, of["insert_plain"])
                stored = timed(
                    lambda t=type_name, c=codec, n=name, z=size, s=sums: decode(
                        t, files.read(n, z, s, 0, z, n), c
                    ),
                    of["read_stored"],
                )
                plain = timed(
                    lambda t=type_name, w=whole, p=path, s=plain_sums: w.decode(t, read_plain(p, s)),
                    of["read_plain"],
                )
                if not stored == plain == value:
                    raise SystemExit(f"{product} {record.id}: the value read differs from that written")
                total = sizes[product]
                total[0] += 1
                total[1] += path.stat().st_size
                total[2] += size
                total[3] += files.path(name).stat().st_size
                files.remove(name)
                path.unlink()
    return {
        product: {
            "payloads": n,
            "plain_mb": round(plain_bytes / 1e6, 3),
            "stored_mb": round(stored_bytes / 1e6, 3),
            "plain_mb_each": round(plain_bytes / n / 1e6, 3),
            "encoded_mb_each": round(encoded_bytes / n / 1e6, 3),
            "stored_mb_each": round(stored_bytes / n / 1e6, 3),
        }
        | {
            f"{name}_{kind}_ms": round(statistics.median(row[i] for row in rows), 3)
            for name, rows in times[product].items()
            for i, kind in enumerate(("wall", "cpu"))
        }
        for product, (n, plain_bytes, encoded_bytes, stored_bytes) in sizes.items()
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
    totals = {key: round(sum(row[key] for row in products.values()), 3) for key in ("plain_mb", "stored_mb")}
    write_report({"products": products, "total": totals}, args.out)


if __name__ == "__main__":
    main()
