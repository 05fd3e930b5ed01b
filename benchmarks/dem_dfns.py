# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU time and memory of the elevation DFNs, and of the DFPC with a window and with a global map.

python benchmarks/dem_dfns.py [--out FILE] [--rounds N]

Times are CPU seconds (``time.process_time``) on one thread after a warm-up call; memory is the peak
allocation of one call (tracemalloc). The ground is simulated. The results are the ``cost:`` in ``dfn.yaml``.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _report import measure, write_report
from numpy.typing import NDArray

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap, LidarScan, TransformWithCovariance
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs
from cdff_core.dfns.dem_registration.interface import DemRegistrationInputs
from cdff_core.dfns.ground_segmentation.interface import GroundSegmentationInputs

SEED = 1
SWEEP_POINTS = 57_600
MS = 1_000_000
Points = NDArray[np.float64]


def relief(xy: Points) -> Points:
    """Return the heights ``(n,)`` of smooth hills at positions ``(n, 2)``, metres."""
    x, y = xy.T
    return 0.3 * np.sin(x / 1.3) * np.cos(y / 1.1) + 0.1 * np.sin(0.7 * x + y)


def dem(size_m: float, cell_m: float, points: int) -> ElevationMap:
    """Return an elevation map of the hills with a corner at the origin."""
    rng = np.random.default_rng(SEED)
    geometry = GridGeometry.aligned("site", cell_m, (0.0, 0.0, size_m, size_m))
    xy = rng.uniform(0.0, size_m, (points, 2))
    cloud = np.column_stack([xy, relief(xy) + rng.normal(0.0, 0.01, points)])
    layers = CellStatistics.from_points(geometry, cloud, stamps_ns=0).to_layers(0)
    return ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)


def node(name: str, implementation: str, **config: Any) -> Any:
    """Return a configured DFN."""
    dfn = Registry.default().make_dfn(name, implementation)
    dfn.configure(config)
    return dfn


def calls() -> dict[str, tuple[Callable[[], object], str]]:
    """Return for each DFN the call to measure and a description of its input."""
    rng = np.random.default_rng(SEED)
    patch, map_around = dem(50.0, 0.05, 2_000_000), dem(40.0, 0.05, 2_000_000)
    xy = rng.uniform(10.0, 30.0, (20_000, 2))
    capture = np.column_stack([xy, relief(xy) + rng.normal(0.0, 0.01, len(xy))]) + np.array(
        [0.02, 0.01, 0.03]
    )
    registration_inputs = DemRegistrationInputs(
        points=capture,
        noise_variance=np.full(len(capture), 1e-4),
        map=map_around,
        centre=np.array([20.0, 20.0, 1.0]),
        covariance=np.diag([0.05, 0.05, 0.05, 0.02, 0.02, 0.02]) ** 2,
    )
    # Number of points and area are those of the largest sample of the ISPRS test; a tenth of the points are
    # on boxes of 6 m height.
    xy = rng.uniform(0.0, 1.0, (38_010, 2)) * np.array([126.0, 303.0])
    segmentation_inputs = GroundSegmentationInputs(
        points=np.column_stack([xy, relief(xy) + 6.0 * (np.sum(xy % 30.0 < 9.0, axis=1) > 1)])
    )
    results: dict[str, tuple[Callable[[], object], str]] = {}
    ground = node("ground_segmentation", "SimpleMorphologicalFilter")
    results["GroundSegmentation/SimpleMorphologicalFilter"] = (
        lambda: ground.process(segmentation_inputs),
        "38010 points over 126 m x 303 m, 1.25 m cells, 4 phases",
    )
    planes = node("dem_registration", "TangentPlanes")
    results["DemRegistration/TangentPlanes"] = (
        lambda: planes.process(registration_inputs),
        "20000 points on a map of 40 m in 5 cm cells",
    )
    for implementation, target in (("RollingWindow", "into a window"), ("TiledMap", "into tiles, a window")):
        fusion = node("dem_fusion", implementation, size_m=50.0)
        results[f"DemFusion/{implementation}"] = (
            lambda fusion=fusion: fusion.process(DemFusionInputs(patch=patch, centre=np.array([25.0, 25.0]))),
            f"1000 x 1000 cells {target} of 1000 x 1000",
        )
    return results


def sweeps(implementation: str, rounds: int) -> dict[str, Any]:
    """Return CPU time and memory of the DFPC per sweep of 57 600 points at 10 Hz over hills, 5 cm cells."""
    rng = np.random.default_rng(SEED)
    frames = FrameGraph()
    frames.set_static(
        "mana/base", "mana/lidar", UncertainTransform(se3.transform(np.eye(3), [0.0, 0.0, 1.0]))
    )
    dfpc = Registry.default().make_dfpc("digital_elevation_mapping")
    dfpc.configure({}, DfpcContext("mana", frames), implementation)
    offset_us = np.sort(rng.integers(0, 100_001, SWEEP_POINTS))
    count, times = 10 * rounds, []
    tracemalloc.start()
    for i in range(count):
        t_ns = i * 100 * MS
        azimuth, distance = rng.uniform(-np.pi, np.pi, SWEEP_POINTS), rng.uniform(1.0, 12.0, SWEEP_POINTS)
        xy = np.column_stack([distance * np.cos(azimuth), distance * np.sin(azimuth)])
        points = np.column_stack([xy, relief(xy + np.array([0.03 * i, 0.0])) - 1.0])
        T = UncertainTransform(se3.transform(np.eye(3), [0.03 * i, 0.0, 0.0]), np.eye(6) * 1e-4)
        pose = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=t_ns)
        scan = LidarScan.from_arrays(points, offset_us, frame="mana/lidar", t0_ns=t_ns - 100 * MS, t1_ns=t_ns)
        # Tracing of allocations takes time: memory is measured in the first half, time in the second half.
        if i == count // 2:
            memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
            tracemalloc.stop()
        started = time.process_time()
        for sample in (Sample("poses", t_ns, i, pose), Sample("scan", t_ns, i, scan)):
            list(dfpc.step(sample))
        times.append(time.process_time() - started)
    timed = times[count // 2 :]
    return {
        "input": f"sweep of {SWEEP_POINTS} points, 10 Hz, 5 cm cells",
        "sweeps": len(timed),
        "cpu_s": round(statistics.median(timed), 4),
        "memory_mb": round(memory_mb),
    }


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    report: dict[str, Any] = {
        "benchmark": "dem_dfns",
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "load_1min": os.getloadavg()[0],
        "rounds": args.rounds,
        "dfns": {
            name: {"input": size} | measure(call, args.rounds) for name, (call, size) in calls().items()
        },
        "dfpc": {name: sweeps(name, args.rounds) for name in ("Lidar", "LidarGlobal")},
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
