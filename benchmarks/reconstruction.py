# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU time and memory of SurfaceFusion on images of 640 x 480 points of a wall.

python benchmarks/reconstruction.py [--out FILE] [--rounds N]
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
import tracemalloc
from pathlib import Path

import numpy as np
from _report import write_report

from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.surface_fusion.interface import SurfaceFusionInputs

FOCAL_PX, DISTANCE_M, VOXEL_M, STEP_M = 585.0, 2.0, 0.01, 0.02


def image(number: int, *, is_extracted: bool) -> SurfaceFusionInputs:
    """Return an image of a wall from a camera that moves along it."""
    u = np.broadcast_to((np.arange(640) - 320.0) / FOCAL_PX, (480, 640))
    v = np.broadcast_to(((np.arange(480) - 240.0) / FOCAL_PX)[:, None], (480, 640))
    points = (DISTANCE_M * np.stack([u, v, np.ones_like(u)], axis=2)).astype(np.float32)
    normals = np.broadcast_to(np.array([0, 0, -1], np.float32), points.shape).copy()
    pose = np.eye(4)
    pose[0, 3] = STEP_M * number
    return SurfaceFusionInputs(
        points=points,
        normals=normals,
        sigmas=np.full((480, 640), 0.005, np.float32),
        camera_matrix=np.array([[FOCAL_PX, 0, 320], [0, FOCAL_PX, 240], [0, 0, 1.0]]),
        pose=pose,
        is_extracted=is_extracted,
    )


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=10)
    args = parser.parse_args()
    dfn = Registry.default().make_dfn("surface_fusion")
    dfn.configure({"voxel_m": VOXEL_M})
    dfn.process(image(0, is_extracted=True))
    tracemalloc.start()
    times = []
    for number in range(1, args.rounds + 1):
        inputs = image(number, is_extracted=False)
        started = time.process_time()
        dfn.process(inputs)
        times.append(time.process_time() - started)
    started = time.process_time()
    surface = dfn.process(image(args.rounds + 1, is_extracted=True))
    report = {
        "benchmark": "reconstruction",
        "python": platform.python_version(),
        "voxel_m": VOXEL_M,
        "TruncatedSignedDistance": {
            "cpu_s_median": round(statistics.median(times), 4),
            "extraction_cpu_s": round(time.process_time() - started, 4),
            "blocks": surface.blocks,
            "memory_mb": round(tracemalloc.get_traced_memory()[1] / 1e6, 1),
        },
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
