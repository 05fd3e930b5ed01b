# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run KISS-Matcher and KISS-ICP in a separate process, optionally in the environment of CDFF_PEER_PYTHON."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import LidarScan

PEER_VOXEL_M = 0.3
_PAIRS = """
import os, sys, time, numpy as np
z = np.load(sys.argv[1])
T, valid, cpu = [], [], []
for i in range(int(z["count"])):
    s, t = z[f"source{i}"], z[f"target{i}"]
    started = time.process_time()
    M, ok = register(s, t)
    cpu.append(time.process_time() - started)
    T.append(M)
    valid.append(ok)
np.savez(sys.argv[2], T=T, valid=valid, cpu=cpu)
"""
_MATCHER = """
import numpy as np, kiss_matcher
matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=VOXEL))
def register(s, t):
    solution = matcher.estimate(list(s.astype(np.float32)), list(t.astype(np.float32)))
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = solution.rotation, solution.translation
    ok = bool(solution.valid)
    matcher.clear()
    return M, ok
"""
_ICP = """
import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
def register(s, t):
    config = KISSConfig()
    config.data.deskew, config.mapping.voxel_size = False, config.data.max_range / 100.0
    config.registration.max_num_threads = 1
    odometry = KissICP(config)
    for cloud in (t, s):
        odometry.register_frame(cloud, np.zeros(len(cloud)))
    return np.array(odometry.last_pose), True
"""
# KISS-ICP deskews with the motion between two sweeps. If a revolution takes only a fraction of the time
# between sweeps, the motion passed to it is scaled by this fraction.
_ODOMETRY = """
import sys, time, numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
folder, min_range_m, max_range_m = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
config = KISSConfig()
config.data.min_range, config.data.max_range = min_range_m, max_range_m
config.mapping.voxel_size = max_range_m / 100.0
config.registration.max_num_threads = 1
odometry = KissICP(config)
preprocess, last_end, poses, cpu, wall = odometry.preprocessor.preprocess, None, [], [], []
def scaled_motion(T, ratio):
    M, A = np.eye(4), 0.5 * (T[:3, :3] - T[:3, :3].T)
    sine = np.sqrt(0.5 * np.sum(A * A))
    angle, K = ratio * np.arctan2(sine, 0.5 * (np.trace(T[:3, :3]) - 1.0)), A / max(sine, 1e-300)
    M[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    M[:3, 3] = ratio * T[:3, 3]
    return M
for n, (sweep_start, sweep_end) in enumerate(np.load(folder + "/spans.npy")):
    z = np.load(f"{folder}/{n}.npz")
    points, fraction = z["points"].astype(np.float64), z["fraction"].astype(np.float64)
    started, clock = time.process_time(), time.perf_counter()
    ratio = 1.0 if last_end is None else (sweep_end - sweep_start) / (sweep_end - last_end)
    motion = scaled_motion(odometry.last_delta, ratio)
    odometry.preprocessor.preprocess = lambda frame, stamps, _: preprocess(frame, stamps, motion)
    if not np.ptp(fraction):  # without point times, deskewing would divide by zero
        fraction = np.zeros(0)
    odometry.register_frame(points, fraction)
    cpu.append(time.process_time() - started)
    wall.append(time.perf_counter() - clock)
    poses.append(odometry.last_pose.copy())
    last_end = sweep_end
np.savez(folder + "/results.npz", poses=poses, cpu=cpu, wall=wall)
"""


def peer_python(package: str = "") -> str | None:
    """Return the Python interpreter for a compared program, or None if there is none.

    It is the interpreter of CDFF_PEER_PYTHON, otherwise this interpreter if it has the package. Evaluations
    omit the rows of a program without an interpreter.
    """
    is_installed = package and importlib.util.find_spec(package) is not None
    return os.environ.get("CDFF_PEER_PYTHON") or (sys.executable if is_installed else None)


def kiss_matcher(
    python: str, pairs: Sequence[tuple[FloatArray, FloatArray]]
) -> list[tuple[FloatArray | None, float]]:
    """Return T_target_source (None if not ``valid``) and CPU seconds of each pair, with voxels of 0.3 m and
    otherwise default parameters.
    """
    return _register_pairs(python, _MATCHER.replace("VOXEL", str(PEER_VOXEL_M)), pairs)


def kiss_icp(
    python: str, pairs: Sequence[tuple[FloatArray, FloatArray]]
) -> list[tuple[FloatArray | None, float]]:
    """Return T_target_source and CPU seconds of each pair, processed as two frames of KISS-ICP's odometry
    without deskewing.
    """
    return _register_pairs(python, _ICP, pairs)


class SweepFile:
    """Sweeps in a temporary folder, for a program in another process; a context manager that deletes them."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._spans_s: list[tuple[float, float]] = []

    def __enter__(self) -> SweepFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def append(self, scan: LidarScan) -> None:
        """Write a sweep."""
        length_us = max((scan.t1_ns - scan.t0_ns) / 1000.0, 1e-3)
        fraction = (np.asarray(scan.time_offset_us) / length_us).astype(np.float32)
        path = Path(self._folder.name) / f"{len(self._spans_s)}.npz"
        np.savez(path, points=np.asarray(scan.points_m, np.float32), fraction=fraction)
        self._spans_s.append((scan.t0_ns / 1e9, scan.t1_ns / 1e9))

    def kiss_icp(
        self, python: str, range_m: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the poses (n, 4, 4) of kiss-icp on one thread, CPU seconds (n,) and wall seconds (n,)."""
        folder = Path(self._folder.name)
        np.save(folder / "spans.npy", np.array(self._spans_s) - self._spans_s[0][0])
        _run([python, "-c", _ODOMETRY, str(folder), *(str(m) for m in range_m)])
        z = np.load(folder / "results.npz")
        return z["poses"], z["cpu"], z["wall"]


def _register_pairs(
    python: str, code: str, pairs: Sequence[tuple[FloatArray, FloatArray]]
) -> list[tuple[FloatArray | None, float]]:
    with tempfile.TemporaryDirectory() as folder:
        input_path, output_path = Path(folder) / "pairs.npz", Path(folder) / "results.npz"
        arrays = {f"source{i}": pair[0] for i, pair in enumerate(pairs)}
        arrays |= {f"target{i}": pair[1] for i, pair in enumerate(pairs)}
        np.savez(input_path, count=np.array(len(pairs)), **arrays)
        _run([python, "-c", code + _PAIRS, str(input_path), str(output_path)])
        z = np.load(output_path)
        return [
            (T if ok else None, float(cpu)) for T, ok, cpu in zip(z["T"], z["valid"], z["cpu"], strict=True)
        ]


def _run(command: list[str]) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
