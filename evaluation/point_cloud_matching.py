# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate point cloud matching on simulated terrain and measured clouds, and its solver on wrong pairs.

Simulated clouds are windows of 20 m of a fractal surface with rocks, with 30 000 points, 1 cm noise, a random
heading and tilts of 5 degrees. Each seed has different terrain. A pose is correct within 0.3 m and 3 degrees.
If two windows share no ground, every answer is wrong. KISS-Matcher processes the same clouds if
CDFF_PEER_PYTHON names an environment with it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from cdff_core.dfns.global_registration_3d.interface import GlobalRegistration3DInputs
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import interval, pose_errors, rate_text
from evaluation.chart import Bar, Panel, chart
from evaluation.data_sets.clouds import devon_halves, small_gicp_pair
from evaluation.peers.environments import kiss_matcher, peer_python
from evaluation.scenes.terrain import window_pair

PARTS = ("solver_alone", "simulated_terrain", "measured_clouds")
PROCESSES = 2
SOLVER_TRIALS = 500
GATE_M, GATE_DEG = 0.3, 3.0
#: Name, overlap, True if the target is on other terrain, number of trials: 500 with overlap, 500 without.
ROWS = (
    ("overlap_0.3", 0.3, False, 125),
    ("overlap_0.5", 0.5, False, 125),
    ("overlap_0.7", 0.7, False, 125),
    ("overlap_0.9", 0.9, False, 125),
    ("no_overlap", 0.0, False, 250),
    ("other_terrain", 0.5, True, 250),
)


@dataclass(frozen=True, slots=True)
class Trial:
    """Result of one registration.

    Attributes
    ----------
    error_m, error_deg : float or None
        Error of translation and rotation; None if there was no answer.
    cpu_s : float
    """

    error_m: float | None
    error_deg: float | None
    cpu_s: float

    @property
    def answered(self) -> bool:
        """True if the method returned a pose."""
        return self.error_m is not None

    def within(self, gate_m: float, gate_deg: float) -> bool:
        """True if the pose is within the limits."""
        return self.error_m is not None and self.error_m <= gate_m and (self.error_deg or 0.0) <= gate_deg


#: Name of a row -> name of a method -> trials.
Trials = dict[str, dict[str, list[Trial]]]


def trial(T: FloatArray | None, T_true: FloatArray, cpu_s: float) -> Trial:
    """Compare an estimated pose with the true pose."""
    return Trial(None, None, cpu_s) if T is None else Trial(*pose_errors(T, T_true), cpu_s)


def summary(trials: Sequence[Trial], gate_m: float, gate_deg: float) -> dict[str, Any]:
    """Return the rates of correct and wrong answers, the errors of correct answers, and CPU time."""
    correct = [t for t in trials if t.within(gate_m, gate_deg)]
    answered = sum(t.answered for t in trials)
    figures: dict[str, Any] = {
        "correct": interval(len(correct), len(trials)),
        "wrong": interval(answered - len(correct), len(trials)),
        "cpu_s": error_summary([t.cpu_s for t in trials]),
    }
    if correct:
        figures |= {
            "error_m": error_summary([t.error_m or 0.0 for t in correct], 5),
            "error_deg": error_summary([t.error_deg or 0.0 for t in correct], 5),
        }
    return figures


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the results of the solver, on simulated and on measured clouds."""
    figures: dict[str, Any] = {}
    if "solver_alone" in parts:
        progress("point_cloud_matching: solver")
        figures["solver_alone"] = solver_recall()
    if "simulated_terrain" in parts:
        figures["simulated_terrain"] = evaluate_terrain(progress)
    if "measured_clouds" in parts:
        progress("point_cloud_matching: measured clouds")
        figures["measured_clouds"] = evaluate_measured(data)
    return figures


def evaluate_terrain(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results on simulated terrain."""
    results: Trials = {}
    seeds = range(max(trials for *_, trials in ROWS))
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        for seed, rows in zip(seeds, pool.map(run_seed, seeds), strict=True):
            progress(f"point_cloud_matching: seed {seed}")
            for name, methods in rows.items():
                for method, trial_ in methods.items():
                    results.setdefault(name, {}).setdefault(method, []).append(trial_)
    return summarise_terrain(results)


def run_seed(seed: int) -> dict[str, dict[str, Trial]]:
    """Return the trials of a seed for each row and method."""
    dfpc, peer = configured(), peer_python("kiss_matcher")
    pairs = {
        n: window_pair(seed, overlap, other_terrain=other)
        for n, overlap, other, trials in ROWS
        if seed < trials
    }
    results: dict[str, dict[str, Trial]] = {}
    for name, (source, target, T_true) in pairs.items():
        T, cpu_s, _ = match_clouds(dfpc, source, target)
        results[name] = {"cdff": trial(T, T_true, cpu_s)}
    if peer:
        answers = kiss_matcher(peer, [pair[:2] for pair in pairs.values()])
        for (name, pair), (T, cpu_s) in zip(pairs.items(), answers, strict=True):
            results[name]["kiss_matcher"] = trial(T, pair[2], cpu_s)
    return results


def summarise_terrain(trials_by_row: Trials) -> dict[str, Any]:
    """Return recall for each overlap and over all overlaps, and false accepts for pairs without overlap."""
    figures: dict[str, Any] = {}
    overlapping = [name for name, overlap, other, _ in ROWS if overlap > 0.0 and not other]
    disjoint = [name for name, *_ in ROWS if name not in overlapping]
    for name in trials_by_row:
        gates = (GATE_M, GATE_DEG) if name in overlapping else (-1.0, -1.0)
        figures[name] = {method: summary(trials, *gates) for method, trials in trials_by_row[name].items()}
    for method in trials_by_row[overlapping[0]]:
        pooled = [t for name in overlapping for t in trials_by_row[name][method]]
        figures.setdefault("all_overlaps", {})[method] = summary(pooled, GATE_M, GATE_DEG)
        others = [t for name in disjoint for t in trials_by_row[name][method]]
        accepted = sum(t.answered for t in others)
        figures.setdefault("false_accepts", {})[method] = interval(accepted, len(others))
    return figures


def solver_recall(trials: int = SOLVER_TRIALS, pairs: int = 1000, wrong: float = 0.98) -> dict[str, Any]:
    """Return recall and CPU time of GlobalRegistration3D in a cube of 2 m with 1 cm noise and random
    outliers.
    """
    solver = Registry.default().make_dfn("global_registration_3d")
    solver.configure({"noise_m": 0.03})
    correct, cpu_s = 0, []
    for seed in range(trials):
        source, target, T = solver_pairs(seed, pairs, wrong)
        started = time.process_time()
        outputs = solver.process(GlobalRegistration3DInputs(source=source, target=target)).transform
        cpu_s.append(time.process_time() - started)
        error_m, error_deg = pose_errors(outputs, T)
        correct += error_m <= 0.05 and error_deg <= GATE_DEG
    return {
        "pairs": pairs,
        "outlier_ratio": wrong,
        "correct": interval(correct, trials),
        "cpu_s": error_summary(cpu_s, 5),
    }


def solver_pairs(seed: int, pairs: int, wrong: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corresponding source and target points ``(n, 3)``, and the true T_target_source."""
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (pairs, 3))
    T = se3.exp_se3(rng.normal(size=6))
    target = se3.transform_points(T, source) + np.clip(rng.normal(0, 0.01, (pairs, 3)), -0.03, 0.03)
    outliers = round(wrong * pairs)
    target[:outliers] = se3.transform_points(T, rng.uniform(-1, 1, (outliers, 3)))
    return source, target, T


def evaluate_measured(data: Path) -> dict[str, Any]:
    """Return for each pair of measured clouds the answer of each method, its errors and its CPU time.

    Pairs are clouds with overlap, clouds with their own copies, and clouds without overlap.
    """
    pairs = measured_pairs(data)
    dfpc, peer = configured(), peer_python("kiss_matcher")
    answers = {"cdff": [match_clouds(dfpc, source, target) for source, target, _ in pairs.values()]}
    if peer:
        clouds = [pair[:2] for pair in pairs.values()]
        answers["kiss_matcher"] = [(T, cpu_s, []) for T, cpu_s in kiss_matcher(peer, clouds)]
    return {
        name: {method: _measured(*answers[method][i], pair[2]) for method in answers}
        for i, (name, pair) in enumerate(pairs.items())
    }


def measured_pairs(data: Path) -> dict[str, tuple[FloatArray, FloatArray, FloatArray | None]]:
    """Return source, target and T_target_source of each pair; None if the clouds share no surface."""
    pairs: dict[str, tuple[FloatArray, FloatArray, FloatArray | None]] = {
        "small_gicp_pair": small_gicp_pair(data),
        "devon_island_halves": devon_halves(data),
    }
    scan, other = (
        np.asarray(read_kitti_bin(data / "kitti_velodyne" / f"{i:06d}.bin").points_m, dtype=np.float64)
        for i in (0, 94)
    )
    road, gicp = pairs["devon_island_halves"][0], pairs["small_gicp_pair"][0]
    clouds = {"kitti 0": scan, "kitti 94": other, "devon island": road, "small gicp": gicp}
    rng = np.random.default_rng(0)
    for name, cloud in clouds.items():
        pairs[f"{name}, own copy"] = cloud, cloud, np.eye(4)
        pairs[f"{name}, copy with 1 mm noise"] = cloud, cloud + rng.normal(0.0, 0.001, cloud.shape), np.eye(4)
    for first, second in combinations(clouds, 2):
        pairs[f"{first} and {second}, no overlap"] = clouds[first], clouds[second], None
    return pairs


def _measured(
    T: FloatArray | None, cpu_s: float, reasons: list[str], T_true: FloatArray | None
) -> dict[str, Any]:
    """Return the answer for a pair of measured clouds; an answer without ``T_true`` is wrong."""
    figures: dict[str, Any] = {"answered": T is not None, "reasons": reasons, "cpu_s": round(cpu_s, 2)}
    if T is not None and T_true is not None:
        error_m, error_deg = pose_errors(T, T_true)
        figures |= {"error_m": round(error_m, 5), "error_deg": round(error_deg, 5)}
    return figures


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: recall by overlap and false accepts, with 95 % intervals, as SVG."""
    rows = figures["simulated_terrain"]
    names = [name for name, overlap, other, _ in ROWS if overlap > 0.0 and not other]
    disjoint = [name for name, *_ in ROWS if name not in names]
    methods = list(rows[names[0]])
    return chart(
        [
            Panel(
                "correct within 0.3 m and 3°, %",
                [f"{float(name.removeprefix('overlap_')):.0%} overlap" for name in names],
                {method: [_percent(rows[name][method]["correct"]) for name in names] for method in methods},
                100.0,
            ),
            Panel(
                "false accepts, %",
                [name.replace("_", " ") for name in disjoint],
                {method: [_percent(rows[name][method]["wrong"]) for name in disjoint] for method in methods},
                40.0,
            ),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the tables: correct and wrong answers of each method, the solver, measured clouds."""
    rows = figures["simulated_terrain"]
    methods = list(rows["all_overlaps"])
    head = " | ".join(f"{m.replace('_', '-')} correct | wrong | median error | CPU s" for m in methods)
    lines = [f"| clouds | {head} |", "|---" * (1 + 4 * len(methods)) + "|"]
    for name in (*(n for n, *_ in ROWS), "all_overlaps"):
        cells = []
        for method in methods:
            row = rows[name][method]
            overlaps = row["correct"]["count"] or ("overlap" in name and name != "no_overlap")
            error = (
                f"{1e3 * row['error_m']['median']:.1f} mm, {row['error_deg']['median']:.2f}°"
                if "error_m" in row
                else "–"
            )
            cells += [rate_text(row["correct"]) if overlaps else "–", rate_text(row["wrong"]), error]
            cells.append(f"{row['cpu_s']['median']:.2f}")
        lines.append(f"| {name.replace('_', ' ')} | {' | '.join(cells)} |")
    accepts = "; ".join(
        f"{method.replace('_', '-')} {rate_text(rate)}" for method, rate in rows["false_accepts"].items()
    )
    solver = figures["solver_alone"]
    lines += ["", f"False accepts without common ground: {accepts}.", ""]
    lines.append(
        f"The solver alone, {solver['pairs']} pairs in a cube of 2 m, 1 cm noise, "
        f"{solver['outlier_ratio']:.0%} of the correspondences random: {rate_text(solver['correct'])} correct, "
        f"median {1e3 * solver['cpu_s']['median']:.1f} ms CPU, at most {1e3 * solver['cpu_s']['max']:.1f} ms."
    )
    measured = figures["measured_clouds"]
    methods = list(next(iter(measured.values())))
    head = " | ".join(f"{m.replace('_', '-')} | CPU s" for m in methods)
    lines += ["", f"| measured clouds | {head} |", "|---" * (1 + 2 * len(methods)) + "|"]
    for name, entries in measured.items():
        cells = [f"{_answer_text(entries[method])} | {entries[method]['cpu_s']:.1f}" for method in methods]
        lines.append(f"| {name.replace('_', ' ')} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _answer_text(entry: dict[str, Any]) -> str:
    if "error_m" in entry:
        return f"{1e3 * entry['error_m']:.1f} mm, {entry['error_deg']:.3f}°"
    if entry["answered"]:
        return "false accept"
    return ", ".join(["FAILED", *(f"`{reason}`" for reason in entry["reasons"])])


def _percent(rate: dict[str, float]) -> Bar:
    return 100.0 * rate["rate"], 100.0 * rate["low"], 100.0 * rate["high"]


@lru_cache(maxsize=1)
def configured() -> Dfpc:
    """Return the DFPC with default configuration, made once per process."""
    dfpc = Registry.default().make_dfpc("point_cloud_matching")
    dfpc.configure()
    return dfpc


def match_clouds(
    dfpc: Any, source: FloatArray, target: FloatArray
) -> tuple[FloatArray | None, float, list[str]]:
    """Return T_target_source or None, CPU seconds for both clouds, and the reasons of the status."""
    dfpc.forget()
    samples = [
        Sample(port, 0, 0, Pointcloud.from_points(points, frame=port, stamp_ns=0))
        for port, points in (("target", target), ("source", source))
    ]
    started = time.process_time()
    (output,) = [output for sample in samples for output in dfpc.step(sample)]
    cpu_s = time.process_time() - started
    return (
        None if output.value is None else output.value.transform.matrix,
        cpu_s,
        list(output.quality.reasons),
    )
