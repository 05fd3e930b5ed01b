# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KISS-Matcher and KISS-ICP on given clouds and sweeps, in a process of their own; CDFF_PEER_PYTHON may name another
environment for it.
"""

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
    found = matcher.estimate(list(s.astype(np.float32)), list(t.astype(np.float32)))
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = found.rotation, found.translation
    ok = bool(found.valid)
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
# It deskews by the motion between sweeps: where a revolution is shorter than their period, it is given its share of it.
_ODOMETRY = """
import sys, time, numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
folder, least, most = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
config = KISSConfig()
config.data.min_range, config.data.max_range = least, most
config.mapping.voxel_size = most / 100.0
config.registration.max_num_threads = 1
odometry = KissICP(config)
preprocess, last, poses, cpu, wall = odometry.preprocessor.preprocess, None, [], [], []
def part(T, share):
    M, A = np.eye(4), 0.5 * (T[:3, :3] - T[:3, :3].T)
    sine = np.sqrt(0.5 * np.sum(A * A))
    angle, K = share * np.arctan2(sine, 0.5 * (np.trace(T[:3, :3]) - 1.0)), A / max(sine, 1e-300)
    M[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    M[:3, 3] = share * T[:3, 3]
    return M
for n, (begin, end) in enumerate(np.load(folder + "/spans.npy")):
    z = np.load(f"{folder}/{n}.npz")
    points, fraction = z["points"].astype(np.float64), z["fraction"].astype(np.float64)
    started, clock = time.process_time(), time.perf_counter()
    motion = part(odometry.last_delta, 1.0 if last is None else (end - begin) / (end - last))
    odometry.preprocessor.preprocess = lambda frame, stamps, _: preprocess(frame, stamps, motion)
    odometry.register_frame(points, fraction)
    cpu.append(time.process_time() - started)
    wall.append(time.perf_counter() - clock)
    poses.append(odometry.last_pose.copy())
    last = end
np.savez(folder + "/found.npz", poses=poses, cpu=cpu, wall=wall)
"""


def peer_python(package: str = "") -> str | None:
    """Interpreter that has the peer: of CDFF_PEER_PYTHON, else this one where it has the package.

    None where there is neither: the peer's rows are then left out.
    """
    has_it = package and importlib.util.find_spec(package) is not None
    return os.environ.get("CDFF_PEER_PYTHON") or (sys.executable if has_it else None)


def kiss_matcher(python: str, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray | None, float]]:
    """T_target_source or None (not ``valid``), and CPU seconds, of each pair; its defaults, voxels of 0.3 m."""
    return _registered(python, _MATCHER.replace("VOXEL", str(PEER_VOXEL_M)), pairs)


def kiss_icp(python: str, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray | None, float]]:
    """T_target_source and CPU seconds of each pair as two frames of its odometry; defaults, without deskewing."""
    return _registered(python, _ICP, pairs)


class SweepFile:
    """Sweeps on disk, for a peer that reads one after the other; a context manager, gone with it."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._spans_s: list[tuple[float, float]] = []

    def __enter__(self) -> SweepFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def append(self, scan: LidarScan) -> None:
        """Keep a sweep."""
        length_us = max((scan.t1_ns - scan.t0_ns) / 1000.0, 1e-3)
        fraction = (np.asarray(scan.time_offset_us) / length_us).astype(np.float32)
        path = Path(self._folder.name) / f"{len(self._spans_s)}.npz"
        np.savez(path, points=np.asarray(scan.points_m, np.float32), fraction=fraction)
        self._spans_s.append((scan.t0_ns / 1e9, scan.t1_ns / 1e9))

    def kiss_icp(self, python: str, range_m: tuple[float, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses (n, 4, 4) of kiss-icp's odometry, CPU and wall seconds (n,) of each sweep; on one thread."""
        folder = Path(self._folder.name)
        np.save(folder / "spans.npy", np.array(self._spans_s) - self._spans_s[0][0])
        _run([python, "-c", _ODOMETRY, str(folder), *(str(m) for m in range_m)])
        z = np.load(folder / "found.npz")
        return z["poses"], z["cpu"], z["wall"]


def _registered(
    python: str, code: str, pairs: Sequence[tuple[FloatArray, FloatArray]]
) -> list[tuple[FloatArray | None, float]]:
    with tempfile.TemporaryDirectory() as folder:
        given, taken = Path(folder) / "pairs.npz", Path(folder) / "found.npz"
        arrays = {f"source{i}": pair[0] for i, pair in enumerate(pairs)}
        arrays |= {f"target{i}": pair[1] for i, pair in enumerate(pairs)}
        np.savez(given, count=np.array(len(pairs)), **arrays)
        _run([python, "-c", code + _PAIRS, str(given), str(taken)])
        z = np.load(taken)
        return [(T if ok else None, float(cpu)) for T, ok, cpu in zip(z["T"], z["valid"], z["cpu"], strict=True)]


def _run(command: list[str]) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
