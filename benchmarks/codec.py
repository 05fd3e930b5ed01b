# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU times of the codecs and of asn1tools on one core.

python benchmarks/codec.py [--out FILE] [--trials N]

Times are the minimum of the trials (``time.process_time``), in milliseconds, after a warm-up call.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from _report import write_report

from cdff_common import types
from cdff_common.codecs import decode, encode, reference
from cdff_common.geometry.uncertain_transform import UncertainTransform

POINTS = 100_000


def messages(rng: np.random.Generator) -> dict[str, Any]:
    """Return the messages to encode and decode, by name."""
    points = rng.normal(scale=20.0, size=(POINTS, 3))
    T = UncertainTransform(np.eye(4), np.diag(rng.uniform(1e-4, 1e-2, 6)))
    state = types.RigidBodyState.from_transform(T, parent="site", child="mana/base", stamp_ns=0)
    return {
        "Pointcloud 100 000 points": types.Pointcloud.from_points(points, frame="mana/lidar", stamp_ns=0),
        "Pointcloud 100 000 points, colours, intensity": types.Pointcloud.from_points(
            points,
            frame="mana/lidar",
            stamp_ns=0,
            colors=rng.uniform(size=(POINTS, 3)),
            intensity=np.arange(POINTS),
        ),
        "LidarScan 100 000 points": types.LidarScan.from_arrays(
            points, np.arange(POINTS), frame="mana/lidar", t0_ns=0, t1_ns=POINTS * 1000
        ),
        "Frame 1920x1200 mono": types.Frame.from_image(
            rng.integers(0, 256, (1200, 1920), dtype=np.uint8), stamp_ns=0, camera_matrix=np.eye(3)
        ),
        "TransformWithCovariance": types.TransformWithCovariance.from_transform(
            T, parent="site", child="mana/base", stamp_ns=0
        ),
        "RigidBodyState": state,
    }


def least_ms(call: Callable[[], Any], trials: int) -> float:
    """Return the minimum CPU time of a call, milliseconds; short calls are repeated within a trial."""
    start = time.process_time()
    call()
    once_s = time.process_time() - start
    repeats = max(1, min(1000, int(0.01 / max(once_s, 1e-6))))
    best = float("inf")
    for _ in range(trials):
        start = time.process_time()
        for _ in range(repeats):
            call()
        best = min(best, (time.process_time() - start) / repeats)
    return round(1e3 * best, 4)


_FIRST_USE = """
import time
start = time.process_time()
import numpy as np
from cdff_common import types
from cdff_common.codecs import decode, encode
imported = time.process_time()
cloud = types.Pointcloud.from_points(np.zeros((1000, 3)), frame="a", stamp_ns=0)
for codec in ("uper", "msgpack"):
    decode("Pointcloud", encode(cloud, codec), codec)
print(imported - start, time.process_time() - imported)
"""


def first_use() -> dict[str, float]:
    """Return CPU seconds of imports and of the first cloud in a new process, with bytecode and kernels
    cached.
    """
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    for _ in range(2):
        completed = subprocess.run(
            [sys.executable, "-c", _FIRST_USE], env=environment, capture_output=True, text=True, check=True
        )
    imports_s, first_s = (float(v) for v in completed.stdout.split())
    return {
        "imports_cpu_s": round(imports_s, 3),
        "first_cloud_each_way_uper_and_msgpack_cpu_s": round(first_s, 3),
    }


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="write JSON here too")
    parser.add_argument("--trials", type=int, default=5)
    args = parser.parse_args()
    results: dict[str, Any] = {}
    for name, value in messages(np.random.default_rng(0)).items():
        type_name = type(value).ASN1_NAME
        row: dict[str, Any] = {}
        for codec in ("uper", "msgpack"):
            data = encode(value, codec)
            row[codec] = {
                "bytes": len(data),
                "encode_ms": least_ms(lambda v=value, c=codec: encode(v, c), args.trials),
                "decode_ms": least_ms(lambda n=type_name, d=data, c=codec: decode(n, d, c), args.trials),
            }
        data = reference.encode(value, "uper")
        row["asn1tools uper"] = {
            "bytes": len(data),
            "encode_ms": least_ms(lambda v=value: reference.encode(v, "uper"), 1),
            "decode_ms": least_ms(lambda n=type_name, d=data: reference.decode(n, d, "uper"), 1),
        }
        results[name] = row
    report = {
        "what": "CPU time on one core, minimum of the trials",
        "trials": args.trials,
        "machine": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        "load_average": os.getloadavg()[0],
        "first_use": first_use(),
        "results": results,
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
