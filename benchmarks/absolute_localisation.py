# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare raster matching with scikit-image's masked phase correlation: CPU time and accuracy.

python benchmarks/absolute_localisation.py [--out FILE] [--trials N] [--peer-python PYTHON]

Both process the same simulated segments of 30 m, mapped without pose errors, shifted by up to 15 m and not
rotated, and an orbital model of 1 m cells with 0.15 m noise. scikit-image (``phase_cross_correlation`` with
masks) estimates whole cells only, and neither rotation nor height; it gets the heights relative to their
mean, in a second row the slopes. Times are CPU seconds (``time.process_time``) of one thread. Without
``--peer-python`` (CDFF_PEER_PYTHON, with scikit-image) its rows are omitted.
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

import numpy as np
from _report import write_report

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry, aggregate_to, slope_rad
from cdff_common.types import ElevationMap
from cdff_core.dfns.raster_matching.interface import RasterMatchingInputs
from cdff_dev.compare.error_summary import error_summary
from evaluation.scenes.orbital import Ground

FALSE_M, SHIFT_M = 3.0, 15.0
_PEER = """
import sys, time, numpy as np
from skimage.registration import phase_cross_correlation
z = np.load(sys.argv[1])
shifts, cpu = [], []
for i in range(int(z["count"])):
    a, b = z[f"a{i}"], z[f"b{i}"]
    started = time.process_time()
    masks = {"reference_mask": z[f"m{i}"], "moving_mask": z[f"n{i}"]}
    result = phase_cross_correlation(a, b, **masks, overlap_ratio=0.2)
    cpu.append(time.process_time() - started)
    shifts.append(result[0] if isinstance(result, tuple) else result)
np.savez(sys.argv[2], shifts=np.array(shifts), cpu=np.array(cpu))
"""


def segment(seed: int) -> tuple[ElevationMap, ElevationMap, FloatArray]:
    """Return the orbital model, the map of a half-observed corridor of 30 m x 14 m, and its shift (x, y),
    metres.
    """
    ground, rng = Ground.make(seed), np.random.default_rng([seed, 12])
    shift = rng.uniform(-SHIFT_M, SHIFT_M, 2) / np.sqrt(2.0)
    geometry = GridGeometry.aligned("site", 0.2, (-15, -7, 15, 7))
    x, y = (c.ravel() for c in geometry.centres_m())
    z = ground.at(np.column_stack([x, y]) + shift) + rng.normal(0.0, 0.02, x.shape)
    observed = rng.random(x.shape) < 0.5
    points = np.column_stack([x, y, z])[observed]
    layers = CellStatistics.from_points(geometry, points, stamps_ns=0).to_layers(0)
    return ground.orbital(seed, 12.0), ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0), shift


def raster_matching(
    segments: list[tuple[ElevationMap, ElevationMap, FloatArray]], search_deg: float
) -> dict[str, Any]:
    """Return errors and CPU time of the DFN."""
    node = Registry.default().make_dfn("raster_matching")
    node.configure({"search_m": SHIFT_M + 5.0, "search_deg": search_deg})
    errors, cpu = [], []
    for orbital, rover_map, shift in segments:
        started = time.process_time()
        outputs = node.process(RasterMatchingInputs(reference=orbital, template=rover_map))
        cpu.append(time.process_time() - started)
        errors.append(float(np.hypot(*(outputs.transforms[0][:2, 3] - shift))))
    return _row(errors, cpu)


def scikit_image(
    segments: list[tuple[ElevationMap, ElevationMap, FloatArray]], python: str, slopes: bool
) -> dict[str, Any]:
    """Return errors and CPU time of scikit-image in cells of the orbital model.

    Its search range cannot be limited; the window of the orbital model is limited instead.
    """
    arrays: dict[str, Any] = {"count": len(segments)}
    for i, (orbital, rover_map, _) in enumerate(segments):
        layers = {name: rover_map.layer(name) for name in rover_map.layer_names}
        coarse = aggregate_to(
            CellStatistics.from_layers(rover_map.geometry, layers, 0), orbital.geometry.resolution_m
        )
        half = 35.0
        window = GridGeometry.aligned(orbital.geometry.frame, 1.0, (-half, -half, half, half))
        reference = orbital.layer("mean")[orbital.geometry.slices_of(window)].astype(np.float64)
        moving = np.full(window.shape, np.nan)
        moving[window.slices_of(coarse.geometry)] = np.where(coarse.observed, coarse.mean, np.nan)
        if slopes:
            reference, moving = slope_rad(reference, 1.0), slope_rad(moving, 1.0)
        for name, mask, grid in (("a", "m", reference), ("b", "n", moving)):
            observed = np.isfinite(grid)
            arrays[f"{name}{i}"] = np.where(observed, grid - grid[observed].mean(), 0.0)
            arrays[f"{mask}{i}"] = observed
    with tempfile.TemporaryDirectory() as folder:
        np.savez(f"{folder}/in.npz", **arrays)
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        subprocess.run(
            [python, "-c", _PEER, f"{folder}/in.npz", f"{folder}/out.npz"], check=True, env=environment
        )
        with np.load(f"{folder}/out.npz") as out:
            shifts, cpu = out["shifts"], out["cpu"]
    # Row indices increase downwards: a shift by -1 row is a shift by +1 m in y.
    errors = [
        float(np.hypot(columns - shift[0], -rows - shift[1]))
        for (rows, columns), (_, _, shift) in zip(shifts, segments, strict=True)
    ]
    return _row(errors, list(cpu))


def _row(errors: list[float], cpu: list[float]) -> dict[str, Any]:
    correct = [e for e in errors if e <= FALSE_M]
    return {
        "within_3_m": f"{len(correct)} of {len(errors)}",
        "error_of_those_m": error_summary(correct),
        "cpu_s": error_summary(cpu),
    }


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument(
        "--peer-python", default=os.environ.get("CDFF_PEER_PYTHON"), help="interpreter with scikit-image"
    )
    args = parser.parse_args()
    segments = [segment(seed) for seed in range(args.trials)]
    report: dict[str, Any] = {
        "benchmark": "absolute_localisation",
        "python": platform.python_version(),
        "machine": platform.machine(),
        "raster matching, no rotation": raster_matching(segments, 0.0),
        "raster matching, rotations within 10 deg": raster_matching(segments, 10.0),
    }
    if args.peer_python:
        report["scikit-image, heights"] = scikit_image(segments, args.peer_python, slopes=False)
        report["scikit-image, slopes"] = scikit_image(segments, args.peer_python, slopes=True)
    write_report(report, args.out)


if __name__ == "__main__":
    main()
