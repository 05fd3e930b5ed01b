# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CPU time and accuracy of raster matching beside scikit-image's masked phase correlation, on the same segments.

python benchmarks/absolute_localisation.py [--out FILE] [--trials N] [--peer-python PYTHON]

Simulated ground; segments of 30 m mapped without errors of the rover's pose, shifted by up to 15 m, without turn, in
an orbital model of 1 m cells with 0.15 m noise. The peer (``phase_cross_correlation`` with masks; it knows whole cells
only and neither turns nor heights) gets the heights about their means, and as a second row the slopes. CPU seconds
(``time.process_time``) of one thread. Without ``--peer-python`` (CDFF_PEER_PYTHON, with scikit-image) its rows are
left out.
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
from _report import give_out

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry, aggregate_to, slope_rad
from cdff_common.types import ElevationMap
from cdff_core.dfns.raster_matching._interface import RasterMatchingInputs
from cdff_dev.evaluate._orbital import Ground
from cdff_dev.evaluate.record import spread

FALSE_M, SHIFT_M = 3.0, 15.0
_PEER = """
import sys, time, numpy as np
from skimage.registration import phase_cross_correlation
z = np.load(sys.argv[1])
shifts, cpu = [], []
for i in range(int(z["count"])):
    a, b = z[f"a{i}"], z[f"b{i}"]
    started = time.process_time()
    found = phase_cross_correlation(a, b, reference_mask=z[f"m{i}"], moving_mask=z[f"n{i}"], overlap_ratio=0.2)
    cpu.append(time.process_time() - started)
    shifts.append(found[0] if isinstance(found, tuple) else found)
np.savez(sys.argv[2], shifts=np.array(shifts), cpu=np.array(cpu))
"""


def segment(seed: int) -> tuple[ElevationMap, ElevationMap, FloatArray]:
    """Orbital model, map of a corridor of 30 m x 14 m seen to half, and the shift (x, y) that was put on it."""
    ground, rng = Ground.make(seed), np.random.default_rng([seed, 12])
    shift = rng.uniform(-SHIFT_M, SHIFT_M, 2) / np.sqrt(2.0)
    geometry = GridGeometry.aligned("site", 0.2, (-15, -7, 15, 7))
    x, y = (c.ravel() for c in geometry.centres_m())
    z = ground.at(np.column_stack([x, y]) + shift) + rng.normal(0.0, 0.02, x.shape)
    seen = rng.random(x.shape) < 0.5
    layers = CellStatistics.from_points(geometry, np.column_stack([x, y, z])[seen], stamps_ns=0).to_layers(0)
    return ground.orbital(seed, 12.0), ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0), shift


def ours(pieces: list[tuple[ElevationMap, ElevationMap, FloatArray]], search_deg: float) -> dict[str, Any]:
    """Errors and CPU time of the DFN."""
    node = Registry.default().make_dfn("raster_matching")
    node.configure({"search_m": SHIFT_M + 5.0, "search_deg": search_deg})
    errors, cpu = [], []
    for orbital, mapped, shift in pieces:
        started = time.process_time()
        found = node.process(RasterMatchingInputs(orbital, mapped))
        cpu.append(time.process_time() - started)
        errors.append(float(np.hypot(*(found.transforms[0][:2, 3] - shift))))
    return _row(errors, cpu)


def peer(pieces: list[tuple[ElevationMap, ElevationMap, FloatArray]], python: str, slopes: bool) -> dict[str, Any]:
    """The same of scikit-image, in cells of the orbital model; the search cannot be limited, so the window is."""
    arrays: dict[str, Any] = {"count": len(pieces)}
    for i, (orbital, mapped, _) in enumerate(pieces):
        layers = {name: mapped.layer(name) for name in mapped.layer_names}
        coarse = aggregate_to(CellStatistics.from_layers(mapped.geometry, layers, 0), orbital.geometry.resolution_m)
        half = 35.0
        window = GridGeometry.aligned(orbital.geometry.frame, 1.0, (-half, -half, half, half))
        reference = orbital.layer("mean")[orbital.geometry.slices_of(window)].astype(np.float64)
        moving = np.full(window.shape, np.nan)
        moving[window.slices_of(coarse.geometry)] = np.where(coarse.observed, coarse.mean, np.nan)
        if slopes:
            reference, moving = slope_rad(reference, 1.0), slope_rad(moving, 1.0)
        for name, mask, grid in (("a", "m", reference), ("b", "n", moving)):
            seen = np.isfinite(grid)
            arrays[f"{name}{i}"], arrays[f"{mask}{i}"] = np.where(seen, grid - grid[seen].mean(), 0.0), seen
    with tempfile.TemporaryDirectory() as folder:
        np.savez(f"{folder}/in.npz", **arrays)
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        subprocess.run([python, "-c", _PEER, f"{folder}/in.npz", f"{folder}/out.npz"], check=True, env=environment)
        with np.load(f"{folder}/out.npz") as out:
            shifts, cpu = out["shifts"], out["cpu"]
    # Rows grow downwards: a shift of the map by -row cells is one of +y.
    errors = [float(np.hypot(s[1] - p[2][0], -s[0] - p[2][1])) for s, p in zip(shifts, pieces, strict=True)]
    return _row(errors, list(cpu))


def _row(errors: list[float], cpu: list[float]) -> dict[str, Any]:
    right = [e for e in errors if e <= FALSE_M]
    return {"within_3_m": f"{len(right)} of {len(errors)}", "error_of_those_m": spread(right), "cpu_s": spread(cpu)}


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument(
        "--peer-python", default=os.environ.get("CDFF_PEER_PYTHON"), help="interpreter with scikit-image"
    )
    args = parser.parse_args()
    pieces = [segment(seed) for seed in range(args.trials)]
    report: dict[str, Any] = {
        "benchmark": "absolute_localisation", "python": platform.python_version(), "machine": platform.machine(),
        "ours, no turn": ours(pieces, 0.0), "ours, turns within 10 deg": ours(pieces, 10.0),
    }  # fmt: skip
    if args.peer_python:
        report["scikit-image, heights"] = peer(pieces, args.peer_python, slopes=False)
        report["scikit-image, slopes"] = peer(pieces, args.peer_python, slopes=True)
    give_out(report, args.out)


if __name__ == "__main__":
    main()
