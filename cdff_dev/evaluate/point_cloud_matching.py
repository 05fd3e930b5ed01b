# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point cloud matching: its solver among wrong pairs, terrain that overlaps in part or not at all, measured clouds.

Terrain is simulated: windows of 20 m of a fractal surface with rocks, 30 000 points sampled anew for each cloud with
1 cm noise, any heading, tilts of 5 degrees; one terrain a seed. Right is within 0.3 m and 3 degrees. Where two windows
share no ground every answer is wrong. KISS-Matcher sees the same clouds where CDFF_PEER_PYTHON names an environment
that has it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
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
from cdff_core.dfns.global_registration_3d._interface import GlobalRegistration3DInputs
from cdff_dev.evaluate._chart import Bar, Panel, chart
from cdff_dev.evaluate._clouds import devon_halves, small_gicp_pair
from cdff_dev.evaluate._peers import kiss_matcher, peer_python
from cdff_dev.evaluate._terrain import window_pair
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import Trial, in_words, interval, pose_errors, summary, trial

PROCESSES = 2
SOLVER_TRIALS = 500
GATE_M, GATE_DEG = 0.3, 3.0
#: Name, overlap, whether the target lies on other terrain, and trials: 500 that overlap, and 500 that do not.
ROWS = (
    ("overlap_0.3", 0.3, False, 125),
    ("overlap_0.5", 0.5, False, 125),
    ("overlap_0.7", 0.7, False, 125),
    ("overlap_0.9", 0.9, False, 125),
    ("no_overlap", 0.0, False, 250),
    ("other_terrain", 0.5, True, 250),
)
Found = dict[str, dict[str, list[Trial]]]


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Figures of the solver, of simulated and of measured clouds."""
    progress("point_cloud_matching: solver")
    figures: dict[str, Any] = {"solver_alone": of_solver()}
    found: Found = {}
    seeds = range(max(trials for *_, trials in ROWS))
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        for seed, rows in zip(seeds, pool.map(on_terrain, seeds), strict=True):
            progress(f"point_cloud_matching: seed {seed}")
            for name, methods in rows.items():
                for method, trial_ in methods.items():
                    found.setdefault(name, {}).setdefault(method, []).append(trial_)
    return figures | {"simulated_terrain": of_terrain(found), "measured_clouds": on_measured(data)}


def on_terrain(seed: int) -> dict[str, dict[str, Trial]]:
    """The trial of every row and method with a seed."""
    dfpc, peer = made(), peer_python("kiss_matcher")
    pairs = {n: window_pair(seed, overlap, other_terrain=other) for n, overlap, other, trials in ROWS if seed < trials}
    found: dict[str, dict[str, Trial]] = {}
    for name, (source, target, T_true) in pairs.items():
        T, cpu_s, _ = matched(dfpc, source, target)
        found[name] = {"cdff": trial(T, T_true, cpu_s)}
    if peer:
        answers = kiss_matcher(peer, [pair[:2] for pair in pairs.values()])
        for (name, pair), (T, cpu_s) in zip(pairs.items(), answers, strict=True):
            found[name]["kiss_matcher"] = trial(T, pair[2], cpu_s)
    return found


def of_terrain(found: Found) -> dict[str, Any]:
    """Recall with its interval for each overlap and over all, and false accepts where there is none."""
    figures: dict[str, Any] = {}
    shared = [name for name, overlap, other, _ in ROWS if overlap > 0.0 and not other]
    apart = [name for name, *_ in ROWS if name not in shared]
    for name in found:
        gates = (GATE_M, GATE_DEG) if name in shared else (-1.0, -1.0)
        figures[name] = {method: summary(trials, *gates) for method, trials in found[name].items()}
    for method in found[shared[0]]:
        pooled = [t for name in shared for t in found[name][method]]
        figures.setdefault("all_overlaps", {})[method] = summary(pooled, GATE_M, GATE_DEG)
        none = [t for name in apart for t in found[name][method]]
        figures.setdefault("false_accepts", {})[method] = interval(sum(t.answered for t in none), len(none))
    return figures


def of_solver(trials: int = SOLVER_TRIALS, pairs: int = 1000, wrong: float = 0.98) -> dict[str, Any]:
    """Recall and CPU time of GlobalRegistration3D: a cube of 2 m, noise 1 cm, wrong partners random."""
    solver = Registry.default().make_dfn("global_registration_3d")
    solver.configure({"noise_m": 0.03})
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
        error_m, error_deg = pose_errors(found, T)
        right += error_m <= 0.05 and error_deg <= GATE_DEG
    return {"pairs": pairs, "wrong_share": wrong, "right": interval(right, trials), "cpu_s": spread(cpu_s, 5)}


def on_measured(data: Path) -> dict[str, Any]:
    """Errors on measured clouds; two drives that never met."""
    dfpc = made()
    figures: dict[str, Any] = {}
    for name, pair in {"small_gicp_pair": small_gicp_pair(data), "devon_island_halves": devon_halves(data)}.items():
        T, cpu_s, reasons = matched(dfpc, *pair[:2])
        errors = {} if T is None else dict(zip(("error_m", "error_deg"), pose_errors(T, pair[2]), strict=True))
        figures[name] = {"answered": T is not None, "reasons": reasons, "cpu_s": round(cpu_s, 2)} | {
            key: round(value, 5) for key, value in errors.items()
        }
    scans = [read_kitti_bin(data / "kitti_velodyne" / f"{i:06d}.bin").points_m for i in (0, 94)]
    T, cpu_s, reasons = matched(dfpc, *scans)
    figures["kitti 94 with 0, which never met"] = {
        "answered": T is not None, "reasons": reasons, "cpu_s": round(cpu_s, 2)
    }  # fmt: skip
    return figures


def draw(figures: dict[str, Any]) -> bytes:
    """Recall by overlap, and false accepts, with their 95 % intervals."""
    rows = figures["simulated_terrain"]
    names = [name for name, overlap, other, _ in ROWS if overlap > 0.0 and not other]
    apart = [name for name, *_ in ROWS if name not in names]
    methods = list(rows[names[0]])
    return chart(
        [
            Panel(
                "right within 0.3 m and 3°, %",
                [f"{float(name.removeprefix('overlap_')):.0%} overlap" for name in names],
                {method: [_percent(rows[name][method]["right"]) for name in names] for method in methods},
                100.0,
            ),
            Panel(
                "false accepts, %",
                [name.replace("_", " ") for name in apart],
                {method: [_percent(rows[name][method]["wrong"]) for name in apart] for method in methods},
                40.0,
            ),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Right and wrong answers of each method, the solver, and measured clouds."""
    rows = figures["simulated_terrain"]
    methods = list(rows["all_overlaps"])
    head = " | ".join(f"{m.replace('_', '-')} right | wrong | median error | CPU s" for m in methods)
    lines = [f"| clouds | {head} |", "|---" * (1 + 4 * len(methods)) + "|"]
    for name in (*(n for n, *_ in ROWS), "all_overlaps"):
        cells = []
        for method in methods:
            row = rows[name][method]
            shares = row["right"]["count"] or ("overlap" in name and name != "no_overlap")
            error = (
                f"{1e3 * row['error_m']['median']:.1f} mm, {row['error_deg']['median']:.2f}°"
                if "error_m" in row
                else "–"
            )
            cells += [in_words(row["right"]) if shares else "–", in_words(row["wrong"]), error]
            cells.append(f"{row['cpu_s']['median']:.2f}")
        lines.append(f"| {name.replace('_', ' ')} | {' | '.join(cells)} |")
    accepts = "; ".join(
        f"{method.replace('_', '-')} {in_words(rate)}" for method, rate in rows["false_accepts"].items()
    )
    solver = figures["solver_alone"]
    lines += ["", f"False accepts where no ground is shared: {accepts}.", ""]
    lines.append(
        f"The solver alone, {solver['pairs']} pairs in a cube of 2 m, 1 cm noise, {solver['wrong_share']:.0%} of the "
        f"partners random: {in_words(solver['right'])} right, median {1e3 * solver['cpu_s']['median']:.1f} ms CPU, "
        f"at most {1e3 * solver['cpu_s']['max']:.1f} ms."
    )
    lines += ["", "| measured clouds | answer | CPU s |", "|---|---|---|"]
    for name, entry in figures["measured_clouds"].items():
        answer = f"{1e3 * entry['error_m']:.1f} mm, {entry['error_deg']:.3f}°" if entry["answered"] else "FAILED: "
        answer += "" if entry["answered"] else ", ".join(f"`{reason}`" for reason in entry["reasons"])
        lines.append(f"| {name.replace('_', ' ')} | {answer} | {entry['cpu_s']:.1f} |")
    return "\n".join(lines)


def _percent(rate: dict[str, float]) -> Bar:
    return 100.0 * rate["rate"], 100.0 * rate["low"], 100.0 * rate["high"]


@lru_cache(maxsize=1)
def made() -> Dfpc:
    """The DFPC with its default configuration; one in a process."""
    dfpc = Registry.default().make_dfpc("point_cloud_matching")
    dfpc.configure()
    return dfpc


def matched(dfpc: Any, source: FloatArray, target: FloatArray) -> tuple[FloatArray | None, float, list[str]]:
    """T_target_source or None, CPU seconds of both clouds, and the reasons given."""
    dfpc.forget()
    samples = [
        Sample(port, 0, 0, Pointcloud.from_points(points, frame=port, stamp_ns=0))
        for port, points in (("target", target), ("source", source))
    ]
    started = time.process_time()
    (output,) = [output for sample in samples for output in dfpc.step(sample)]
    cpu_s = time.process_time() - started
    return None if output.value is None else output.value.transform.matrix, cpu_s, list(output.quality.reasons)
