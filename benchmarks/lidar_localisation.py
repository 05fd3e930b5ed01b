# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar localisation beside small_gicp scan-to-map on the same sweeps, map and guesses; CPU seconds.

OMP_NUM_THREADS=1 python benchmarks/lidar_localisation.py [--trials N] [--out FILE] [--plot FILE.svg]

The map and the sweeps are those of ``cdff_dev.evaluate.lidar_localisation``: simulated ground, a map put down with the
errors of a survey. small_gicp gets the whole map at our voxel and each guess, with its defaults and with pairs as far
as the guess is off; map and tree are made once for it, as ours are. KISS-ICP gets the same where CDFF_PEER_PYTHON names
an environment that has it: the map as its voxel map, each guess as its prediction, and a kernel of a third of the reach
of pairs, as it has it itself.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import tempfile
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import small_gicp

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.voxels import voxel_means
from cdff_core.dfns.place_search._interface import PlaceSearchInputs
from cdff_dev.evaluate._peers import peer_python
from cdff_dev.evaluate.lidar_localisation import LIMIT_DEG, LIMIT_M, localised, localiser, place, trial

VOXEL_M, SCAN_VOXEL_M, RANGE_M, OFF_M = 0.15, 0.3, 25.0, 5.0
STARTS = {"at the truth": 0.0, "2 m and 20 deg off": 1.0}


class KissIcp:
    """KISS-ICP's registration against a map, in an environment of its own; one call for all sweeps and guesses."""

    CODE = """
import sys, time, numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
z = np.load(sys.argv[1])
config = KISSConfig()
config.data.max_range, config.data.deskew, config.registration.max_num_threads = float(z["range_m"]), False, 1
config.mapping.voxel_size = float(z["range_m"]) / 100.0
odometry = KissICP(config)
odometry.local_map.add_points(z["map"])
T, cpu = [], []
for i, guess in enumerate(z["guesses"]):
    began = time.process_time()
    frame = odometry.preprocessor.preprocess(z[f"sweep{i}"], np.zeros(len(z[f"sweep{i}"])), np.eye(4))
    source, _ = odometry.voxelize(frame)
    T.append(odometry.registration.align_points_to_map(
        points=source, voxel_map=odometry.local_map, initial_guess=guess,
        max_correspondance_distance=float(z["reach_m"]), kernel=float(z["reach_m"]) / 3.0))
    cpu.append(time.process_time() - began)
np.savez(sys.argv[2], T=T, cpu=cpu)
"""

    @staticmethod
    def answers(python: str, points_m: np.ndarray, given: list[Any], reach_m: float) -> list[tuple[np.ndarray, float]]:
        """``T_map_lidar`` and CPU seconds of each of ``given``: a guess and a sweep."""
        with tempfile.TemporaryDirectory() as folder:
            asked, found = Path(folder) / "asked.npz", Path(folder) / "found.npz"
            sweeps = {f"sweep{i}": sweep.astype(np.float64) for i, (_, sweep) in enumerate(given)}
            guesses = np.array([guess for guess, _ in given])
            np.savez(
                asked, map=voxel_means(points_m, VOXEL_M), guesses=guesses, range_m=RANGE_M, reach_m=reach_m, **sweeps
            )
            subprocess.run([python, "-c", KissIcp.CODE, str(asked), str(found)], check=True)
            z = np.load(found)
            return list(zip(z["T"], z["cpu"].tolist(), strict=True))


class Peer:
    """small_gicp against a map."""

    def __init__(self, points_m: np.ndarray, kind: str, reach_m: float) -> None:
        self._kind, self._reach_m = kind, reach_m
        self._map = small_gicp.PointCloud(voxel_means(points_m, VOXEL_M))
        self._tree = small_gicp.KdTree(self._map)
        small_gicp.estimate_normals_covariances(self._map, self._tree, 20)

    def __call__(self, points_m: np.ndarray, T: np.ndarray) -> np.ndarray:
        """``T_map_lidar`` of a sweep from a guess."""
        near = points_m[np.linalg.norm(points_m, axis=1) <= RANGE_M]
        source, _ = small_gicp.preprocess_points(near.astype(np.float64), SCAN_VOXEL_M)
        found = small_gicp.align(
            self._map, source, self._tree, T, registration_type=self._kind, max_correspondence_distance=self._reach_m
        )
        return found.T_target_source


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--plot", type=Path, help="draw the map, the guesses and the answers from them instead")
    args = parser.parse_args()
    ground = place()
    points = ground.map(0)
    tracemalloc.start()
    dfpc = localiser(points)
    memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    if args.plot:
        drawn(args.plot, dfpc, args.trials)
        return
    peers = {
        f"small_gicp {kind}, pairs within {reach:g} m": Peer(points, kind, reach)
        for kind in ("GICP", "PLANE_ICP") for reach in (1.0, OFF_M)
    }  # fmt: skip
    rows: dict[str, dict[str, list[Any]]] = {start: {} for start in STARTS}
    for seed in range(args.trials):
        T, sweep, guess = trial(ground, seed)
        for start, share in STARTS.items():
            begin = guess if share else T
            answers: dict[str, Any] = {"ours": lambda T0, p: _ours(dfpc, p, T0)}
            answers |= {name: lambda T0, p, peer=peer: peer(p, T0) for name, peer in peers.items()}
            for name, answer in answers.items():
                began = time.process_time()
                found = answer(begin, sweep)
                spent = time.process_time() - began
                rows[start].setdefault(name, []).append((*_error(T, found), spent))
    if python := peer_python():
        for start, share in STARTS.items():
            given = [trial(ground, seed) for seed in range(args.trials)]
            asked = [(guess if share else T, sweep) for T, sweep, guess in given]
            for reach_m in (1.0, OFF_M):
                answers_ = KissIcp.answers(python, points, asked, reach_m)
                rows[start][f"kiss-icp, pairs within {reach_m:g} m"] = [
                    (*_error(T, found), spent) for (T, *_), (found, spent) in zip(given, answers_, strict=True)
                ]
    search = dfpc.dfn("search")
    T, sweep, _ = trial(ground, 0)
    began = time.process_time()
    search.process(PlaceSearchInputs(dfpc.store.get("scan_map").points_m, sweep.astype(np.float64)))
    report = {
        "benchmark": "lidar_localisation", "machine": platform.machine(), "trials": args.trials,
        "map_points": len(dfpc.store.get("scan_map").points_m), "memory_mb": round(memory_mb, 1),
        "place_search_cpu_s": round(time.process_time() - began, 3),
        "from": {start: {name: _summary(values) for name, values in named.items()} for start, named in rows.items()},
    }  # fmt: skip
    text = json.dumps(report, indent=1)
    print(text)
    if args.out:
        args.out.write_text(text + "\n")


def drawn(path: Path, dfpc: Any, trials: int) -> None:
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "cdff"
    from matplotlib import pyplot

    points = voxel_means(dfpc.store.get("scan_map").points_m, 1.0)
    figure, axis = pyplot.subplots(figsize=(7, 6))
    shown = axis.scatter(points[:, 0], points[:, 1], c=points[:, 2], s=3, cmap="Greys", linewidths=0, rasterized=True)
    figure.colorbar(shown, label="height of the map, m")
    for seed in range(trials):
        T, sweep, guess = trial(place(), seed)
        nearby, searched = (localised(dfpc, sweep, g) for g in (UncertainTransform(guess), None))
        axis.plot(*guess[:2, 3], "x", color="#c0392b", ms=5, label=None if seed else "guess, 2 m and 20° off")
        for answer, mark, name in ((nearby, "o", "answer from it"), (searched, "+", "answer from nothing")):
            if answer.value is not None:
                at = answer.value.transform.matrix[:2, 3]
                axis.plot(*at, mark, color="#2471a3", ms=5 if mark == "o" else 11, label=None if seed else name)
        axis.plot([guess[0, 3], T[0, 3]], [guess[1, 3], T[1, 3]], "-", color="#c0392b", lw=0.6)
    axis.set(xlabel="x of site, m", ylabel="y of site, m", aspect="equal", xlim=(-25, 75), ylim=(-30, 70))
    axis.legend(loc="lower right", fontsize=8)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None}, dpi=90)


def _ours(dfpc: Any, points_m: np.ndarray, T: np.ndarray) -> np.ndarray | None:
    value = localised(dfpc, points_m, UncertainTransform(T)).value
    return None if value is None else value.transform.matrix


def _error(T: np.ndarray, found: np.ndarray | None) -> tuple[float, float]:
    if found is None:
        return np.inf, np.inf
    E = se3.inverse(T) @ found
    return float(np.linalg.norm(E[:3, 3])), float(np.degrees(se3.rotation_angle(E[:3, :3])))


def _summary(values: list[Any]) -> dict[str, Any]:
    metres, degrees, cpu_s = np.array(values).T
    return {
        "within_3_cm_and_0.1_deg": int(np.sum((metres <= LIMIT_M) & (degrees <= LIMIT_DEG))),
        "wrong_or_refused": int(np.sum(metres > 0.3)),
        "median_m": round(float(np.median(metres)), 5), "median_deg": round(float(np.median(degrees)), 4),
        "median_cpu_s": round(float(np.median(cpu_s)), 4),
    }  # fmt: skip


if __name__ == "__main__":
    main()
