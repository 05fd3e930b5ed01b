# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare lidar localisation with small_gicp and KISS-ICP (scan-to-map) on the same sweeps, map and guesses.

The map and the sweeps are those of ``lidar_localisation``; each method uses one thread. small_gicp gets the
whole map with the voxel size of the DFPC, and each guess. It runs with its default pair distance and with
pairs up to the error of the guess; its map and search tree are built once, as in the DFPC. KISS-ICP runs in a
separate process with the map as its voxel map, each guess as its prediction, and a kernel of a third of the
pair distance, which is its own rule.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.dfpc import Dfpc
from cdff_dev.compare.registration.rates import pose_errors
from evaluation.lidar_localisation import (
    LIMIT_DEG,
    LIMIT_M,
    WRONG_M,
    localise,
    make_localiser,
    simulated_ground,
    trial,
)
from evaluation.peers.environments import peer_python

#: Page that contains the table of this evaluation.
PAGE = "lidar_localisation"

TRIALS = 5
VOXEL_M, SCAN_VOXEL_M, RANGE_M, REACHES_M = 0.15, 0.3, 25.0, (1.0, 5.0)
#: Initial guesses.
STARTS = ("from the true pose", "from 2 m and 20 deg off")


class KissIcp:
    """KISS-ICP's registration to a map in a separate process; one call for all sweeps and guesses."""

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
    started = time.process_time()
    frame = odometry.preprocessor.preprocess(z[f"sweep{i}"], np.zeros(len(z[f"sweep{i}"])), np.eye(4))
    source, _ = odometry.voxelize(frame)
    T.append(odometry.registration.align_points_to_map(
        points=source, voxel_map=odometry.local_map, initial_guess=guess,
        max_correspondance_distance=float(z["reach_m"]), kernel=float(z["reach_m"]) / 3.0))
    cpu.append(time.process_time() - started)
np.savez(sys.argv[2], T=T, cpu=cpu)
"""

    @staticmethod
    def answers(
        python: str, points_m: FloatArray, queries: list[Any], reach_m: float
    ) -> list[tuple[FloatArray, float]]:
        """Return ``T_map_lidar`` and CPU seconds for each query, which is a guess and a sweep."""
        with tempfile.TemporaryDirectory() as folder:
            inputs, outputs = Path(folder) / "inputs.npz", Path(folder) / "outputs.npz"
            sweeps = {f"sweep{i}": sweep.astype(np.float64) for i, (_, sweep) in enumerate(queries)}
            guesses = np.array([guess for guess, _ in queries])
            np.savez(
                inputs,
                map=voxel_means(points_m, VOXEL_M),
                guesses=guesses,
                range_m=RANGE_M,
                reach_m=reach_m,
                **sweeps,
            )
            subprocess.run([python, "-c", KissIcp.CODE, str(inputs), str(outputs)], check=True)
            z = np.load(outputs)
            return list(zip(z["T"], z["cpu"].tolist(), strict=True))


class SmallGicp:
    """small_gicp's registration to a map."""

    def __init__(self, points_m: FloatArray, kind: str, reach_m: float) -> None:
        import small_gicp

        self._kind, self._reach_m = kind, reach_m
        self._map = small_gicp.PointCloud(voxel_means(points_m, VOXEL_M))
        self._tree = small_gicp.KdTree(self._map)
        small_gicp.estimate_normals_covariances(self._map, self._tree, 20)

    def __call__(self, points_m: FloatArray, T: FloatArray) -> FloatArray:
        """Return ``T_map_lidar`` of a sweep from a guess."""
        import small_gicp

        near = points_m[np.linalg.norm(points_m, axis=1) <= RANGE_M]
        source, _ = small_gicp.preprocess_points(near.astype(np.float64), SCAN_VOXEL_M)
        result = small_gicp.align(
            self._map,
            source,
            self._tree,
            T,
            registration_type=self._kind,
            max_correspondence_distance=self._reach_m,
        )
        return result.T_target_source


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors and CPU time of all methods, from the true pose and from the guess."""
    ground = simulated_ground()
    points = ground.map(0)
    dfpc = make_localiser(points)
    peers = {
        f"small_gicp {kind}, pairs within {reach:g} m": SmallGicp(points, kind, reach)
        for kind in ("GICP", "PLANE_ICP")
        for reach in REACHES_M
    }
    python = peer_python("kiss_icp")
    trials = [trial(ground, seed) for seed in range(TRIALS)]
    figures: dict[str, Any] = {"load_1min": round(os.getloadavg()[0], 1)}
    for start in STARTS:
        queries = [(T if start == STARTS[0] else guess, sweep) for T, sweep, guess in trials]
        rows: dict[str, list[tuple[FloatArray | None, float]]] = {}
        for number, (guess, sweep) in enumerate(queries):
            progress(f"lidar localisation and its peers: {start}, {number} of {TRIALS}")
            rows.setdefault("lidar_localisation", []).append(
                _timed(lambda T, p: _localise_with_dfpc(dfpc, p, T), guess, sweep)
            )
            for name, peer in peers.items():
                rows.setdefault(name, []).append(_timed(lambda T, p, peer=peer: peer(p, T), guess, sweep))
        for reach_m in REACHES_M if python else ():
            rows[f"kiss-icp, pairs within {reach_m:g} m"] = KissIcp.answers(
                str(python), points, queries, reach_m
            )
        figures[start] = {name: _summary(row, [T for T, *_ in trials]) for name, row in rows.items()}
    return figures


def _timed(
    localise_from: Callable[[FloatArray, FloatArray], FloatArray | None], guess: FloatArray, sweep: FloatArray
) -> tuple[FloatArray | None, float]:
    started = time.process_time()
    T = localise_from(guess, sweep)
    return T, time.process_time() - started


def _localise_with_dfpc(dfpc: Dfpc, points_m: FloatArray, T: FloatArray) -> FloatArray | None:
    value = localise(dfpc, points_m, UncertainTransform(T)).value
    return None if value is None else value.transform.matrix


def _summary(answers: list[tuple[FloatArray | None, float]], truths: list[FloatArray]) -> dict[str, Any]:
    errors = [
        (np.inf, np.inf) if T is None else pose_errors(T, T_true)
        for (T, _), T_true in zip(answers, truths, strict=True)
    ]
    metres, degrees = np.array(errors).T
    return {
        "trials": len(answers),
        "within_3_cm_and_0.1_deg": int(np.sum((metres <= LIMIT_M) & (degrees <= LIMIT_DEG))),
        "wrong_or_refused": int(np.sum(metres > WRONG_M)),
        "median_m": round(float(np.median(metres)), 5),
        "median_deg": round(float(np.median(degrees)), 4),
        "median_cpu_s": round(float(np.median([cpu_s for _, cpu_s in answers])), 4),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table of all methods from both starts."""
    lines = [f"| | {' | '.join(start.replace(' deg', '°') for start in STARTS)} |", "|---|---|---|"]
    for name in figures[STARTS[0]]:
        cells = []
        for start in STARTS:
            row = figures[start][name]
            cells.append(
                f"{row['within_3_cm_and_0.1_deg']} of {row['trials']}, {1e3 * row['median_m']:.1f} mm, "
                f"{row['median_deg']:.3f}°, {row['median_cpu_s']:.2f} s"
            )
        title = f"**{name}**" if name == "lidar_localisation" else name
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join([*lines, "", f"Load average during the run: {figures['load_1min']}."])
