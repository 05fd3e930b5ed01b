# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU times of navigation mapping: classification of a million cells and of a change, and routes.

python benchmarks/navigation.py [--out FILE] [--rounds N] [--peer-python PYTHON]

Times are medians of CPU seconds (``time.process_time``) on one thread after warm-up. Routes are compared with
scikit-image's MCP_Geometric; it is skipped without ``--peer-python`` (CDFF_PEER_PYTHON, with scikit-image).
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _report import median_cpu_s, write_report
from numpy.typing import NDArray

from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap, NavigationMap
from cdff_core.dfns.route_search.interface import RouteSearchInputs
from cdff_core.dfns.traversability.interface import TraversabilityInputs

SEED = 1
_PEER = """
import sys, time, numpy as np
from skimage.graph import MCP_Geometric
z = np.load(sys.argv[1])
times = []
for _ in range(int(z["rounds"]) + 1):
    started = time.process_time()
    costs, _ = MCP_Geometric(z["price"], sampling=tuple(z["cell"])).find_costs([tuple(z["start"])])
    times.append(time.process_time() - started)
np.savez(sys.argv[2], cpu=np.median(times[1:]), costs=costs)
"""


def hills(cells: int, cell_m: float, *, with_change: bool = False, only_change: bool = False) -> ElevationMap:
    """Return a map of hills with 1 cm of noise.

    ``with_change`` raises a square in the middle, a hundredth of the area; with ``only_change`` only this
    square is observed.
    """
    rng = np.random.default_rng(SEED)
    geometry = GridGeometry.aligned("site", cell_m, (0.0, 0.0, cells * cell_m, cells * cell_m))
    x, y = geometry.centres_m()
    z = 0.5 * np.sin(0.4 * x) * np.cos(0.3 * y) + rng.normal(0.0, 0.01, x.shape)
    middle = 0.5 * cells * cell_m
    is_changed = (np.abs(x - middle) < 0.05 * cells * cell_m) & (np.abs(y - middle) < 0.05 * cells * cell_m)
    z += 0.3 * with_change * is_changed
    observed = is_changed if only_change else np.ones_like(is_changed)
    points = np.column_stack([x[observed], y[observed], z[observed]])
    layers = CellStatistics.from_points(
        geometry, points, stamps_ns=0, height_variance_m2=np.full(len(points), 1e-4)
    ).to_layers(0)
    return ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)


def changes(rounds: int) -> dict[str, float]:
    """Measure the DFPC on 1000 x 1000 cells: the first patch, and patches of a hundredth of the area."""
    node = Registry.default().make_dfpc("navigation_mapping")
    node.configure({"size_m": 50.0, "resolution_m": 0.05})
    first_patch, changed_patch = hills(1000, 0.05), hills(1000, 0.05, with_change=True, only_change=True)
    started = time.process_time()
    list(node.step(Sample("dem", 0, 0, first_patch)))
    first_patch_s = time.process_time() - started
    return {
        "first_patch_cpu_s": first_patch_s,
        "change_of_a_hundredth_cpu_s": median_cpu_s(
            lambda: list(node.step(Sample("dem", 0, 0, changed_patch))), rounds
        ),
    }


def routes(rounds: int, python: str | None) -> dict[str, Any]:
    """Measure the costs to all of 300 x 300 cells, a tenth of them hazards."""
    rng = np.random.default_rng(SEED)
    geometry = GridGeometry.aligned("site", 0.1, (0.0, 0.0, 30.0, 30.0))
    classes = np.where(rng.random(geometry.shape) < 0.1, 3, 1).astype(np.uint8)
    classes[150, 150] = 1
    cost = rng.random(geometry.shape).astype(np.float32)
    navigation_map = NavigationMap.from_layers(geometry, {"class": classes, "cost": cost}, t0_ns=0, t1_ns=0)
    node = Registry.default().make_dfn("route_search")
    node.configure()
    inputs = RouteSearchInputs(map=navigation_map, start=np.array([15.05, 14.95]))
    report: dict[str, Any] = {
        "cells": classes.size,
        "cpu_s": median_cpu_s(lambda: node.process(inputs), rounds),
    }
    if python:
        price = np.where(classes == 1, 1.0 + 4.0 * cost.astype(np.float64), np.inf)
        report |= _compare_with_scikit_image(python, price, (150, 150), rounds, node.process(inputs).costs_m)
    return report


def _compare_with_scikit_image(
    python: str, price: NDArray[np.float64], start: tuple[int, int], rounds: int, costs_m: NDArray[np.float64]
) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        np.savez(f"{folder}/in.npz", price=price, start=start, rounds=rounds, cell=np.array([0.1, 0.1]))
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        subprocess.run(
            [python, "-c", _PEER, f"{folder}/in.npz", f"{folder}/out.npz"], check=True, env=environment
        )
        with np.load(f"{folder}/out.npz") as out:
            reached = np.isfinite(costs_m) & np.isfinite(out["costs"])
            # The peer cuts corners between two hazards, so that its costs are never higher.
            difference = costs_m[reached] - out["costs"][reached]
            below_m = float(max(-difference.min(), 0.0))
            return {
                "mcp_geometric_cpu_s": float(out["cpu"]),
                "ours_below_peer_by_at_most_m": below_m,
                "median_difference_m": float(np.median(difference)),
            }


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument(
        "--peer-python", default=os.environ.get("CDFF_PEER_PYTHON"), help="interpreter with scikit-image"
    )
    args = parser.parse_args()
    cv2.setNumThreads(1)
    traversability, dem = Registry.default().make_dfn("traversability"), hills(1000, 0.05)
    traversability.configure({})
    report: dict[str, Any] = {
        "benchmark": "navigation",
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cells": 1_000_000,
        "traversability_cpu_s": median_cpu_s(
            lambda: traversability.process(TraversabilityInputs(dem=dem)), args.rounds
        ),
        **changes(args.rounds),
        "routes": routes(args.rounds, args.peer_python),
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
