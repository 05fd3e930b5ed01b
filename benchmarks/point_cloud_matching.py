# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""point_cloud_matching beside KISS-Matcher, SHOT beside FPFH, and the solver among wrong pairs; cost of the DFNs.

OMP_NUM_THREADS=1 python benchmarks/point_cloud_matching.py [--data DIR] [--trials N] [--solver-trials N]
    [--peer-python PYTHON] [--out FILE]

KISS-Matcher runs in an environment of its own (``--peer-python``, with kiss-matcher and numpy installed), on the same
clouds, with its defaults at a voxel of 0.3 m. Terrain is simulated: a fractal surface with rocks, sampled anew for each
cloud with 1 cm noise, windows of 20 m x 20 m. Rates come with their two-sided 95 % Clopper-Pearson interval.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import tempfile
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.ply import read_ply
from cdff_common.formats.pose import read_pose
from cdff_common.geometry import se3
from cdff_common.geometry.voxels import voxel_for, voxel_means
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from cdff_core.dfns.features_description_3d._interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_extraction_3d._interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_matching_3d._interface import FeaturesMatching3DInputs
from cdff_core.dfns.global_registration_3d._interface import GlobalRegistration3DInputs
from cdff_core.dfns.normals_estimation._interface import NormalsEstimationInputs

Points = NDArray[np.float64]
OVERLAPS = (0.3, 0.5, 0.7, 0.9)
WINDOW_M, POINTS, NOISE_M, PEER_VOXEL_M = 20.0, 30_000, 0.01, 0.3
GATE_M, GATE_DEG = 0.3, 3.0
PEER = """
import sys, time, numpy as np, kiss_matcher
z = np.load(sys.argv[1])
matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=float(sys.argv[3])))
source, target = (z[n].astype(np.float32) for n in ("source", "target"))
T, valid, cpu = [], [], []
for s, t in zip(source, target):
    started = time.process_time()
    found = matcher.estimate(list(s), list(t))
    cpu.append(time.process_time() - started)
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = found.rotation, found.translation
    T.append(M)
    valid.append(bool(found.valid))
    matcher.clear()
np.savez(sys.argv[2], T=T, valid=valid, cpu=cpu)
"""


class Terrain:
    """A fractal surface over 64 m x 64 m with rocks; heights come from a grid of 0.05 m, interpolated linearly."""

    STEP_M, SIZE_M = 0.05, 64.0

    def __init__(self, seed: int, rocks: int = 250) -> None:
        rng = np.random.default_rng(seed)
        n = round(self.SIZE_M / self.STEP_M)
        f = np.hypot(*np.meshgrid(np.fft.fftfreq(n, self.STEP_M), np.fft.rfftfreq(n, self.STEP_M), indexing="ij"))
        f[0, 0] = np.inf
        spectrum = np.where(f < 1.0 / 32.0, 0.0, f**-2.0) * np.exp(2j * np.pi * rng.random(f.shape))
        z = np.fft.irfft2(spectrum, s=(n, n))
        z *= 0.35 / z.std()
        x = np.arange(n) * self.STEP_M
        for cx, cy, r in zip(*rng.uniform(0, self.SIZE_M, (2, rocks)), rng.uniform(0.1, 0.5, rocks), strict=True):
            i = slice(*np.clip(np.searchsorted(x, [cx - r, cx + r]), 0, n))
            j = slice(*np.clip(np.searchsorted(x, [cy - r, cy + r]), 0, n))
            inside = np.maximum(r**2 - (x[i, None] - cx) ** 2 - (x[None, j] - cy) ** 2, 0.0)
            z[i, j] += rng.uniform(0.5, 1.0) * np.sqrt(inside)
        self._z = z

    def window(self, rng: np.random.Generator, x_m: float, y_m: float) -> Points:
        """Points of a window whose low corner is given, noise added."""
        xy = rng.uniform(0, WINDOW_M, (POINTS, 2)) + np.array([x_m, y_m])
        g = xy / self.STEP_M
        i, (u, v) = g.astype(int), (g % 1.0).T
        z = self._z
        z00, z10 = z[i[:, 0], i[:, 1]], z[i[:, 0] + 1, i[:, 1]]
        z01, z11 = z[i[:, 0], i[:, 1] + 1], z[i[:, 0] + 1, i[:, 1] + 1]
        height = (1 - u) * (1 - v) * z00 + u * (1 - v) * z10 + (1 - u) * v * z01 + u * v * z11
        return np.c_[xy, height] + rng.normal(0, NOISE_M, (POINTS, 3))


def simulated_pair(seed: int, overlap: float) -> tuple[Points, Points, Points]:
    """Source, target and T_target_source: any heading, tilts of 10 degrees, overlap in share of a window's area."""
    rng = np.random.default_rng(seed)
    terrain = Terrain(seed)
    shift = WINDOW_M * (1.0 - overlap)
    if overlap <= 0.0:
        shift = 1.2 * WINDOW_M
    a, b = terrain.window(rng, 1.0, 5.0), terrain.window(rng, 1.0 + shift, 5.0)
    centre = a.mean(axis=0)
    turn = se3.exp_so3(np.radians(rng.normal(0, 5.0, 3))) @ se3.exp_so3(np.array([0, 0, rng.uniform(-np.pi, np.pi)]))
    T_target_terrain = se3.transform(turn, rng.normal(0, 10.0, 3) - turn @ centre)
    # The source lies about its origin, so that an error there is an error at the cloud.
    return a - centre, se3.transform_points(T_target_terrain, b), T_target_terrain @ se3.transform(np.eye(3), centre)


def interval(right: int, trials: int) -> dict[str, float]:
    """Rate with its two-sided 95 % Clopper-Pearson interval."""
    from scipy.stats import beta

    low = float(beta.ppf(0.025, right, trials - right + 1)) if right else 0.0
    high = float(beta.ppf(0.975, right + 1, trials - right)) if right < trials else 1.0
    return {"count": right, "trials": trials, "rate": right / trials, "low": low, "high": high}


def errors(T: Points, T_true: Points) -> tuple[float, float]:
    """Distance of the translations, metres, at the origin, and angle between the rotations, degrees."""
    angle = se3.rotation_angle(T[:3, :3] @ T_true[:3, :3].T)
    return float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])), float(np.degrees(angle))


def is_right(T: Points, T_true: Points) -> bool:
    """Within 0.3 m and 3 degrees."""
    error_m, error_deg = errors(T, T_true)
    return error_m <= GATE_M and error_deg <= GATE_DEG


def ours(dfpc: Any, source: Points, target: Points) -> tuple[Points | None, float, list[str]]:
    """T_target_source or None, CPU seconds, and reasons."""
    started = time.process_time()
    values = (("target", target), ("source", source))
    (output,) = [
        o
        for port, points in values
        for o in dfpc.step(Sample(port, 0, 0, Pointcloud.from_points(points, frame=port, stamp_ns=0)))
    ]
    cpu_s = time.process_time() - started
    dfpc.forget()
    return None if output.value is None else output.value.transform.matrix, cpu_s, list(output.quality.reasons)


def on_terrain(trials: int, peer: str | None) -> dict[str, Any]:
    """Recall per overlap, false accepts where there is none; the peer on the same clouds."""
    dfpc = Registry.default().make_dfpc("point_cloud_matching")
    dfpc.configure()
    report: dict[str, Any] = {}
    for overlap in (*OVERLAPS, 0.0):
        pairs = [simulated_pair(1000 * round(10 * overlap) + seed, overlap) for seed in range(trials)]
        found = [ours(dfpc, source, target) for source, target, _ in pairs]
        truths = [T for *_, T in pairs]
        row: dict[str, Any] = {"cdff": _summary([f[0] for f in found], truths, [f[1] for f in found])}
        if peer:
            T, cpu_s = of_peer(peer, pairs)
            row["kiss_matcher"] = _summary(T, truths, cpu_s)
        report[f"overlap_{overlap:g}"] = row
    return report


def _summary(T: list[Points | None], truths: list[Points], cpu_s: list[float]) -> dict[str, Any]:
    answered = [(t, truth) for t, truth in zip(T, truths, strict=True) if t is not None]
    right = [errors(t, truth) for t, truth in answered if is_right(t, truth)]
    summary: dict[str, Any] = {
        "right": interval(len(right), len(T)), "wrong": interval(len(answered) - len(right), len(T)),
        "median_cpu_s": statistics.median(cpu_s),
    }  # fmt: skip
    if right:
        summary |= {"median_m": float(np.median(right, axis=0)[0]), "median_deg": float(np.median(right, axis=0)[1])}
    return summary


def of_peer(python: str, pairs: list[tuple[Points, Points, Points]]) -> tuple[list[Points | None], list[float]]:
    """What KISS-Matcher finds, in its own environment."""
    with tempfile.TemporaryDirectory() as folder:
        given, taken = Path(folder) / "pairs.npz", Path(folder) / "found.npz"
        np.savez(given, source=[p[0] for p in pairs], target=[p[1] for p in pairs])
        command = [python, "-c", PEER, str(given), str(taken), str(PEER_VOXEL_M)]
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        z = np.load(taken)
        return [T if ok else None for T, ok in zip(z["T"], z["valid"], strict=True)], z["cpu"].tolist()


def of_solver(trials: int, pairs: int = 1000, wrong: float = 0.98) -> dict[str, Any]:
    """Recall and CPU time of GlobalRegistration3D: a cube of 2 m, noise 1 cm, wrong partners random."""
    solver = node("global_registration_3d", None, noise_m=0.03)
    right, cpu_s = 0, []
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        source = rng.uniform(-1, 1, (pairs, 3))
        T = se3.exp_se3(rng.normal(size=6))
        target = se3.transform_points(T, source) + np.clip(rng.normal(0, 0.01, (pairs, 3)), -0.03, 0.03)
        outliers = round(wrong * pairs)
        target[:outliers] = se3.transform_points(T, rng.uniform(-1, 1, (outliers, 3)))
        started = time.process_time()
        found = solver.process(GlobalRegistration3DInputs(source, target)).transform
        cpu_s.append(time.process_time() - started)
        error_m, error_deg = errors(found, T)
        right += error_m <= 0.05 and error_deg <= GATE_DEG
    times = {"median_cpu_s": statistics.median(cpu_s), "max_cpu_s": max(cpu_s)}
    return {"pairs": pairs, "wrong_share": wrong, "right": interval(right, trials), **times}


def node(name: str, implementation: str | None = None, **config: Any) -> Any:
    """A configured DFN."""
    made = Registry.default().make_dfn(name, implementation)
    made.configure(config)
    return made


def real_pairs(data: Path) -> dict[str, tuple[Points, Points, Points]]:
    """Source, target and T_target_source of clouds that were measured."""
    folder = data / "small_gicp_pair"
    source, target = (read_ply(folder / f"{name}.ply").points_m for name in ("source", "target"))
    pairs = {"small_gicp_pair": (source, target, read_pose(folder / "T_target_source.txt").T.matrix)}
    folder = data / "cdff_upstream" / "PointClouds"
    road, copy = (read_ply(folder / f"DevonIslandRoad1{name}.ply").points_m for name in ("", "TransformedNoise"))
    truth = [float(v) for v in (folder / "CloudsTransform.txt").read_text().split()]
    R = se3.matrix_from_quaternion_xyzw(truth[3:])
    order, half = np.random.default_rng(0).permutation(len(road)), len(road) // 2
    pairs["devon_island_halves"] = (road[order[:half]], copy[order[half:]], se3.transform(R, R @ np.array(truth[:3])))
    return pairs


def of_descriptors(data: Path) -> dict[str, Any]:
    """Share of mutual matches that are right, at equal keypoints and radii; CPU time per keypoint."""
    report: dict[str, Any] = {}
    for name, (source, target, T) in real_pairs(data).items():
        voxel_m = max(voxel_for(source, 8000), voxel_for(target, 8000))
        clouds = [voxel_means(points, voxel_m) for points in (source, target)]
        normals = [node("normals_estimation").process(NormalsEstimationInputs(p)).normals for p in clouds]
        keypoints = [
            node("features_extraction_3d").process(FeaturesExtraction3DInputs(p, np.array(1.5 * voxel_m))).keypoints
            for p in clouds
        ]
        for radius in (8.0, 12.0, 15.0):
            for kind in ("Shot", "Fpfh"):
                config = {"signed_normals": False} if kind == "Shot" else {}
                describe = node("features_description_3d", kind, **config)
                given = [
                    FeaturesDescription3DInputs(p, n, k, np.array(radius * voxel_m))
                    for p, n, k in zip(clouds, normals, keypoints, strict=True)
                ]
                describe.process(given[0])
                started = time.process_time()
                found = [describe.process(g) for g in given]
                cpu_s = time.process_time() - started
                matching = FeaturesMatching3DInputs(found[0].descriptors, found[1].descriptors)
                matches = node("features_matching_3d").process(matching).matches
                off = se3.transform_points(T, keypoints[0][matches[:, 0]]) - keypoints[1][matches[:, 1]]
                right = int(np.count_nonzero(np.linalg.norm(off, axis=1) <= 1.5 * voxel_m))
                report[f"{name} {kind} radius {radius:g} voxels"] = {
                    "matches": len(matches), "right": right, "share": right / max(len(matches), 1),
                    "us_per_keypoint": 1e6 * cpu_s / (len(keypoints[0]) + len(keypoints[1])),
                }  # fmt: skip
    return report


def of_dfns(data: Path, rounds: int) -> dict[str, Any]:
    """CPU seconds and memory of each DFN, at the sizes that their descriptions name."""
    source, *_ = real_pairs(data)["small_gicp_pair"]
    voxel_m = voxel_for(source, 8000)
    points = voxel_means(source, voxel_m)
    normals = node("normals_estimation").process(NormalsEstimationInputs(points)).normals
    keypoints = node("features_extraction_3d", max_keypoints=1000).process(FeaturesExtraction3DInputs(points)).keypoints
    rng = np.random.default_rng(0)
    descriptors = [rng.random((2000, 352), np.float32) for _ in range(2)]
    pairs = [rng.uniform(-1, 1, (1000, 3)) for _ in range(2)]
    pairs[1][:20] = pairs[0][:20]
    described = FeaturesDescription3DInputs(points, normals, keypoints, np.array(10.0 * voxel_m))
    calls: dict[str, tuple[Any, Any]] = {
        "FeaturesExtraction3D/Uniform": (node("features_extraction_3d"), FeaturesExtraction3DInputs(points)),
        "FeaturesExtraction3D/Iss": (node("features_extraction_3d", "Iss"), FeaturesExtraction3DInputs(points)),
        "FeaturesDescription3D/Shot": (node("features_description_3d"), described),
        "FeaturesDescription3D/Fpfh": (node("features_description_3d", "Fpfh"), described),
        "FeaturesMatching3D/MutualRatio": (node("features_matching_3d"), FeaturesMatching3DInputs(*descriptors)),
        "GlobalRegistration3D/CliqueGnc": (
            node("global_registration_3d", noise_m=0.03), GlobalRegistration3DInputs(*pairs)
        ),
    }  # fmt: skip
    report = {}
    for name, (dfn, inputs) in calls.items():
        dfn.process(inputs)
        times = []
        for _ in range(rounds):
            started = time.process_time()
            dfn.process(inputs)
            times.append(time.process_time() - started)
        tracemalloc.start()
        dfn.process(inputs)
        report[name] = {"cpu_s": statistics.median(times), "memory_mb": tracemalloc.get_traced_memory()[1] / 1e6}
        tracemalloc.stop()
    report["sizes"] = {"points": len(points), "keypoints": len(keypoints)}
    return report


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or beside))
    parser.add_argument("--trials", type=int, default=25, help="per overlap")
    parser.add_argument("--solver-trials", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--peer-python", help="interpreter of an environment with kiss-matcher")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report = {
        "benchmark": "point_cloud_matching", "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"), "load_1min": os.getloadavg()[0],
        "solver": of_solver(args.solver_trials), "descriptors": of_descriptors(args.data),
        "dfns": of_dfns(args.data, args.rounds),
    }  # fmt: skip
    if args.trials:
        report["simulated_terrain"] = on_terrain(args.trials, args.peer_python)
    text = json.dumps(report, indent=1)
    print(text)
    if args.out:
        args.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
