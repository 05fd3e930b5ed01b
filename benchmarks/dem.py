# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU times of the steps of elevation and navigation mapping, and of numpy and OpenCV alone.

python benchmarks/dem.py [--out FILE] [--rounds N]

Times are medians of CPU seconds (``time.process_time``) after a warm-up, each part in its own process.
The stereo pair is the first of KITTI_sequence_1 if it is in CDFF_DATA, otherwise a random texture of the same
size; the report states which one was used.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _report import median_cpu_s, write_report
from numpy.typing import NDArray
from scipy.stats import binned_statistic_dd

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import (
    ElevationMap,
    Frame,
    FramePair,
    LidarScan,
    TransformWithCovariance,
)
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs
from cdff_core.dfns.dem_rasterisation.interface import DemRasterisationInputs
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs
from cdff_core.dfns.point_cloud_deskewing.interface import PointCloudDeskewingInputs
from cdff_core.dfns.traversability.interface import TraversabilityInputs
from evaluation.peers.atlaas import AtlaasMap

SEED = 1
POINTS = 2_000_000
GRID = GridGeometry.aligned("site", 0.05, (0.0, 0.0, 50.0, 50.0))
SWEEP_POINTS = 57_600
MS = 1_000_000


def make_node(name: str, **config: Any) -> Any:
    """Return a configured DFN."""
    node = Registry.default().make_dfn(name)
    node.configure(config)
    return node


def numpy_statistics(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Compute the same statistics (without stamps) by plain numpy: bincount, minimum.at, maximum.at."""
    row, col, inside = GRID.cells_of(points[:, 0], points[:, 1])
    cell, z = (row * GRID.cols + col)[inside], points[inside, 2]
    cells = GRID.rows * GRID.cols
    n = np.bincount(cell, minlength=cells).astype(np.float64)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(cell, z, cells) / n
        variance = np.bincount(cell, z * z, cells) / n - mean**2
    low, high = np.full(cells, np.inf), np.full(cells, -np.inf)
    np.minimum.at(low, cell, z)
    np.maximum.at(high, cell, z)
    return n, mean, variance, low, high


def scipy_statistics(points: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Compute the same statistics by SciPy's ``binned_statistic_dd``."""
    x0, y0, x1, y1 = GRID.bounds
    edges = [np.linspace(y0, y1, GRID.rows + 1), np.linspace(x0, x1, GRID.cols + 1)]
    yx, z = points[:, [1, 0]], points[:, 2]
    count = binned_statistic_dd(yx, z, "count", bins=edges)
    others = [
        binned_statistic_dd(yx, z, name, binned_statistic_result=count)  # reuses the cells of the points
        for name in ("mean", "std", "min", "max")
    ]
    return [count.statistic, *(result.statistic for result in others)]


def rasterising(rounds: int) -> dict[str, Any]:
    """Measure rasterising 2 million points into a million cells: kernel, DFN, and with fusion into a map."""
    rng = np.random.default_rng(SEED)
    points = np.column_stack([rng.uniform(0.0, 50.0, (POINTS, 2)), rng.normal(0.0, 1.0, POINTS)])
    raster, fusion = make_node("dem_rasterisation"), make_node("dem_fusion", size_m=50.0)
    inputs = DemRasterisationInputs(frame="site", points=points)
    patch: ElevationMap = raster.process(inputs).map
    centre = np.array([25.0, 25.0])

    def update() -> None:
        fusion.process(DemFusionInputs(patch=raster.process(inputs).map, centre=centre))

    kernel, plain = CellStatistics.from_points(GRID, points, stamps_ns=0), numpy_statistics(points)
    atlaas = AtlaasMap(GRID)
    observed = kernel.observed.ravel()
    return {
        "points": POINTS,
        "cells": GRID.rows * GRID.cols,
        "kernel_cpu_s": median_cpu_s(lambda: CellStatistics.from_points(GRID, points, stamps_ns=0), rounds),
        "dfn_cpu_s": median_cpu_s(lambda: raster.process(inputs), rounds),
        "fusion_cpu_s": median_cpu_s(
            lambda: fusion.process(DemFusionInputs(patch=patch, centre=centre)), rounds
        ),
        "full_update_cpu_s": median_cpu_s(update, rounds),
        "numpy_bincount_cpu_s": median_cpu_s(lambda: numpy_statistics(points), rounds),
        "scipy_binned_statistic_dd_cpu_s": median_cpu_s(lambda: scipy_statistics(points), 1),
        "fusion_by_atlaas_rules_in_numpy_cpu_s": median_cpu_s(lambda: atlaas.merge(patch, centre), rounds),
        "largest_difference_of_means_m": float(np.max(np.abs(kernel.mean.ravel() - plain[1])[observed])),
    }


def deskewing(rounds: int) -> dict[str, Any]:
    """Measure deskewing of 100 000 points over 10 poses."""
    rng, n = np.random.default_rng(SEED), 100_000
    stamps = np.arange(11) * 10 * MS
    inputs = PointCloudDeskewingInputs(
        points=rng.normal(0.0, 5.0, (n, 3)),
        stamps_ns=rng.integers(0, 100_001, n) * 1000,
        poses=se3.exp_se3(np.outer(np.arange(11), [0.01, 0, 0, 0, 0, 0.01])),
        pose_stamps_ns=stamps,
        pose_covariances=np.tile(np.eye(6) * 1e-4, (11, 1, 1)),
    )
    node = make_node("point_cloud_deskewing")
    return {"points": n, "poses": len(stamps), "cpu_s": median_cpu_s(lambda: node.process(inputs), rounds)}


def stereo_pair() -> tuple[str, NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a description of the pair, and its left and right image."""
    root = Path(os.environ.get("CDFF_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
    names = [root / "kitti_stereo/KITTI_sequence_1" / f"image_{side}_kitti" / "000000.png" for side in "lr"]
    if all(name.exists() for name in names):
        left, right = (cv2.imread(str(name), cv2.IMREAD_GRAYSCALE) for name in names)
        return "KITTI_sequence_1, pair 0", left, right
    noise = np.random.default_rng(SEED).integers(0, 256, (376, 1241), dtype=np.uint8)
    return "random texture, disparity 30 px", noise, np.roll(noise, -30, axis=1)


def matching(rounds: int) -> dict[str, Any]:
    """Measure the disparity of a KITTI-sized pair, and one pass of OpenCV's SGBM for comparison."""
    description, left, right = stereo_pair()
    K = np.array([[707.0912, 0, 601.8873], [0, 707.0912, 183.1104], [0, 0, 1]])
    inputs = DisparityImageInputs(
        left=Frame.from_image(left, stamp_ns=0, camera_matrix=K), right=Frame.from_image(right, stamp_ns=0)
    )
    plain = cv2.StereoSGBM.create(0, 128, 5, 200, 800, 1, 31, 10)
    report: dict[str, Any] = {"pair": description, "shape": list(left.shape)}
    for count in (128, 64):
        node = make_node("disparity_image", num_disparities=count)
        report[f"dfn_{count}_disparities_cpu_s"] = median_cpu_s(
            lambda node=node: node.process(inputs), rounds
        )
    report["opencv_sgbm_128_cpu_s"] = median_cpu_s(lambda: plain.compute(left, right), rounds)
    return report


def sweeps(rounds: int) -> dict[str, Any]:
    """Measure the whole DFPC per sweep of 57 600 points at 10 Hz, with 5 cm cells and patches of 2 s."""
    rng = np.random.default_rng(SEED)
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/lidar", UncertainTransform(se3.transform(np.eye(3), [0, 0, 1.0])))
    node = Registry.default().make_dfpc("digital_elevation_mapping")
    node.configure({}, DfpcContext("mana", frames), "Lidar")
    azimuth, distance = rng.uniform(-np.pi, np.pi, SWEEP_POINTS), rng.uniform(1.0, 12.0, SWEEP_POINTS)
    points = np.column_stack(
        [distance * np.cos(azimuth), distance * np.sin(azimuth), np.full(SWEEP_POINTS, -1.0)]
    )
    offset_us = np.sort(rng.integers(0, 100_001, SWEEP_POINTS))
    count, spent_s, patches = 20 * rounds, 0.0, 0
    for i in range(-1, count):
        t_ns = (i + 1) * 100 * MS
        T = UncertainTransform(se3.transform(np.eye(3), [0.03 * i, 0, 0]), np.eye(6) * 1e-4)
        pose = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=t_ns)
        samples = [Sample("poses", t_ns, i + 1, pose)]
        if i >= 0:
            scan = LidarScan.from_arrays(
                points, offset_us, frame="mana/lidar", t0_ns=t_ns - 100 * MS, t1_ns=t_ns
            )
            samples.insert(0, Sample("scan", t_ns, i, scan))
        started = time.process_time()
        for sample in samples:
            patches += sum(o.port == "map" for o in node.step(sample))
        spent_s += time.process_time() - started
    return {"points": SWEEP_POINTS, "sweeps": count, "patches": patches, "cpu_s_per_sweep": spent_s / count}


def stereo_mapping(rounds: int) -> dict[str, Any]:
    """Measure the whole DFPC on KITTI-sized pairs, 20 cm cells, one patch per pair."""
    description, left, right = stereo_pair()
    K = np.array([[707.0912, 0, 601.8873], [0, 707.0912, 183.1104], [0, 0, 1]])
    T = UncertainTransform.exact(se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 1.65]))
    node = Registry.default().make_dfpc("digital_elevation_mapping")
    node.configure({"resolution_m": 0.2, "max_height_m": 1.0}, DfpcContext("kitti"), "Stereo")
    times = []
    for i in range(rounds + 1):
        t_ns = i * 1000 * MS
        pair = FramePair.from_images(
            left,
            right,
            baseline_m=0.537,
            camera_matrix=K,
            stamp_ns=t_ns,
            sensor="kitti/navcam_left",
            T_robot_sensor=T,
        )
        pose = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(np.eye(3), [5.0 * i, 0, 0]), np.eye(6) * 1e-4),
            parent="site",
            child="kitti/base",
            stamp_ns=t_ns,
        )
        started = time.process_time()
        node.step(Sample("poses", t_ns, i, pose))
        node.step(Sample("stereo", t_ns, i, pair))
        times.append(time.process_time() - started)
    return {"pair": description, "cpu_s_per_pair": statistics.median(times[1:])}


def navigation(rounds: int) -> dict[str, Any]:
    """Measure classification of a million cells, and the whole DFPC per patch of 24 m in a map of 30 m."""
    rng = np.random.default_rng(SEED)

    def rough_ground(size_m: float, resolution_m: float) -> ElevationMap:
        geometry = GridGeometry.aligned("site", resolution_m, (0.0, 0.0, size_m, size_m))
        points = np.column_stack(
            [*(c.ravel() for c in geometry.centres_m()), rng.normal(0.0, 0.01, geometry.rows * geometry.cols)]
        )
        layers = CellStatistics.from_points(geometry, points, stamps_ns=0).to_layers(0)
        return ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)

    node, large_map, patch = make_node("traversability"), rough_ground(50.0, 0.05), rough_ground(24.0, 0.05)
    dfpc = Registry.default().make_dfpc("navigation_mapping")
    dfpc.configure()
    return {
        "cells": 1_000_000,
        "traversability_cpu_s": median_cpu_s(
            lambda: node.process(TraversabilityInputs(dem=large_map)), rounds
        ),
        "patch_cells": patch.geometry.rows * patch.geometry.cols,
        "cpu_s_per_patch": median_cpu_s(lambda: list(dfpc.step(Sample("dem", 0, 0, patch))), rounds),
    }


def with_memory(benchmark: Callable[[int], dict[str, Any]], rounds: int) -> dict[str, Any]:
    """Return the report of a part, with the peak memory growth of this process (VmHWM, reset before)."""
    cv2.setNumThreads(1)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    initial_mb = peak_mb()
    report = benchmark(rounds)
    return {**report, "peak_growth_mb": round(peak_mb() - initial_mb)}


def peak_mb() -> float:
    """Return the largest resident set since the last reset, MB."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args()
    report: dict[str, Any] = {
        "benchmark": "dem",
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "rounds": args.rounds,
    }
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as executor:
        for part in (rasterising, deskewing, matching, sweeps, stereo_mapping, navigation):
            report[part.__name__] = executor.submit(with_memory, part, args.rounds).result()
    write_report(report, args.out)


if __name__ == "__main__":
    main()
