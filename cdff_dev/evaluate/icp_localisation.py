# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ICP localisation against truth: simulated lidar scans on held-out seeds, and measured clouds.

Simulated: pairs of 64 x 1800 scans (some 95 000 points each, 1 cm range noise) of fractal terrain with rocks, up to
1.1 m and 4 degrees apart, from the identity; CPU time is that of the whole DFPC, thinning included. The seeds are none
of those that ``icp_calibration`` learns from. Squared normalised errors use the stated covariances: 6 is expected.

Measured: two lidar pairs from the identity, and Devon Island's road: the copy is R (original + t), noisy by 0.5 mm,
point for point. Model and scene are disjoint halves of the points, one of the original, one of the copy, so that no
point has its twin. A guess is the truth with its translation off by up to 0.5 m and its rotation by up to 10 degrees,
both uniform in size and in direction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output
from cdff_common.interfaces.product import Status
from cdff_dev.evaluate._chart import Bar, Panel, chart
from cdff_dev.evaluate._clouds import devon_halves, kitti_pair, small_gicp_pair
from cdff_dev.evaluate._icp import IMPLEMENTATIONS, localised, made
from cdff_dev.evaluate._terrain import scan_pair
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import in_words, interval, nees_band, pose_errors

#: Two blocks of a hundred that served for nothing: single trials reach 35 where 6 is expected, so one block scatters.
HELD_OUT_SEEDS = (*range(3000, 3100), *range(4000, 4100))
DEVON_TRIALS = 100
MAX_GUESS_M, MAX_GUESS_DEG = 0.5, 10.0
LIMIT_M, LIMIT_DEG = 0.02, 0.1


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Errors, CPU time and honesty of covariances."""
    found: dict[str, list[tuple[Output, float, FloatArray]]] = {name: [] for name in IMPLEMENTATIONS}
    dfpcs = {name: made(name) for name in IMPLEMENTATIONS}
    for seed in HELD_OUT_SEEDS:
        progress(f"icp_localisation: seed {seed}")
        for name, entry in on_terrain(dfpcs, seed).items():
            found[name].append(entry)
    progress("icp_localisation: measured clouds")
    dfpc = dfpcs["PointToPlane"]
    pairs = {"kitti_velodyne 94/95, from identity": kitti_pair, "small_gicp_pair, from identity": small_gicp_pair}
    measured: dict[str, Any] = {}
    for name, read in pairs.items():
        source, target, T_true = read(data)
        measured[name] = _error(localised(dfpc, target, source)[0], T_true)
    return {
        "simulated_scans": {name: of_terrain(entries) for name, entries in found.items()},
        "measured_clouds": measured | {"devon_island": _devon(dfpc, data, progress)},
    }


def on_terrain(dfpcs: dict[str, Any], seed: int) -> dict[str, tuple[Output, float, FloatArray]]:
    """Output, CPU seconds and truth of each implementation."""
    scene, model, T_true = scan_pair(seed)
    return {name: (*localised(dfpc, scene, model), T_true) for name, dfpc in dfpcs.items()}


def of_terrain(entries: Sequence[tuple[Output, float, FloatArray]]) -> dict[str, Any]:
    """Errors, CPU time, and squared normalised errors with the 95 % band of their mean."""
    answered = [(output.value.transform, T) for output, _, T in entries if output.value is not None]
    errors = [pose_errors(T.matrix, T_true) for T, T_true in answered]
    nees, sigma_m, sigma_deg = [], [], []
    for T, T_true in answered:
        e = pose_error(T_true, T.matrix)
        nees.append(float(e @ np.linalg.solve(T.covariance, e)))
        variance = np.diag(T.covariance)
        sigma_m.append(float(np.sqrt(variance[:3].sum())))
        sigma_deg.append(float(np.degrees(np.sqrt(variance[3:].sum()))))
    low, high = nees_band(len(nees))
    return {
        "seeds": list(HELD_OUT_SEEDS[: len(entries)]),
        "refused": len(entries) - len(answered),
        "error_m": spread([m for m, _ in errors], 5), "error_deg": spread([d for _, d in errors], 5),
        "cpu_s": spread([cpu_s for _, cpu_s, _ in entries], 4),
        "nees": {"mean": round(float(np.mean(nees)), 2), "band_95": [round(low, 2), round(high, 2)],
                 "inside": low <= float(np.mean(nees)) <= high, "max": round(max(nees), 1)},
        "mean_sigma_m": round(float(np.mean(sigma_m)), 5), "mean_sigma_deg": round(float(np.mean(sigma_deg)), 5),
        "covariance_kind": str(entries[0][0].quality.covariance_kind),
    }  # fmt: skip


def draw(figures: dict[str, Any]) -> bytes:
    """Errors, CPU time and honesty of the covariances of each implementation on simulated scans."""
    rows = figures["simulated_scans"]
    names = list(rows)

    def spread_of(key: str, factor: float) -> dict[str, list[Bar | None]]:
        bars = [tuple(factor * rows[name][key][of] for of in ("median", "min", "p95")) for name in names]
        return {"median, least to 95 %": bars}

    nees: dict[str, list[Bar | None]] = {"mean, and 95 % band": [(rows[n]["nees"]["mean"],) * 3 for n in names]}
    band = tuple(rows[names[0]]["nees"]["band_95"])
    return chart(
        [
            Panel("error, mm", names, spread_of("error_m", 1e3), 40.0),
            Panel("CPU, ms", names, spread_of("cpu_s", 1e3), 500.0),
            Panel("squared normalised error, 6 expected", names, nees, 10.0, band),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Errors, cost and honesty of each implementation on simulated scans; measured clouds."""
    rows = figures["simulated_scans"]
    lines = [
        "| implementation | trials | median error | 95 % | greatest | CPU ms | mean NEES (95 % band) | mean σ |",
        "|---" * 8 + "|",
    ]
    for name, row in rows.items():
        m, d, nees = row["error_m"], row["error_deg"], row["nees"]
        low, high = nees["band_95"]
        lines.append(
            f"| `{name}` | {m['count'] + row['refused']}, {row['refused']} refused "
            f"| {1e3 * m['median']:.2f} mm, {d['median']:.4f}° "
            f"| {1e3 * m['p95']:.1f} mm, {d['p95']:.3f}° | {1e3 * m['max']:.1f} mm, {d['max']:.3f}° "
            f"| {1e3 * row['cpu_s']['median']:.0f} | {nees['mean']:.2f} ({low:.2f}–{high:.2f}) "
            f"| {1e3 * row['mean_sigma_m']:.2f} mm, {row['mean_sigma_deg']:.4f}° |"
        )
    lines += ["", "| measured clouds, `PointToPlane` | answer |", "|---|---|"]
    measured = figures["measured_clouds"]
    for name in list(measured)[:2]:
        entry = measured[name]
        answer = (
            ", ".join(entry.get("reasons", []))
            or f"{1e3 * entry['translation_m']:.1f} mm, {entry['rotation_deg']:.3f}°"
        )
        lines.append(f"| {name.replace('_', ' ')} | {entry['status']}, {answer} |")
    devon = measured["devon_island"]
    m, d = devon["translation_m"], devon["rotation_deg"]
    lines.append(
        f"| Devon Island, guesses off by up to {MAX_GUESS_M} m and {MAX_GUESS_DEG:g}° "
        f"| within 2 cm and 0.1°: {in_words(devon['within_2_cm_and_0.1_deg'])}, wrong {in_words(devon['wrong'])}; "
        f"median {1e3 * m['median']:.1f} mm, {d['median']:.3f}°, greatest {1e3 * m['max']:.1f} mm, {d['max']:.3f}°; "
        f"mean NEES {devon['mean_nees']} |"
    )
    return "\n".join(lines)


def _devon(dfpc: Any, data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    good, wrong, failed, metres, degrees, nees = 0, 0, 0, [], [], []
    for seed in range(DEVON_TRIALS):
        progress(f"icp_localisation: Devon Island, seed {seed}")
        model, scene, T = devon_halves(data, seed)
        output, _ = localised(dfpc, scene, model, _off(T, np.random.default_rng([seed, 1])))
        if output.quality.status is Status.FAILED:
            failed += 1
            continue
        error_m, error_deg = pose_errors(output.value.transform.matrix, T)
        metres.append(error_m)
        degrees.append(error_deg)
        e = pose_error(T, output.value.transform.matrix)
        nees.append(float(e @ np.linalg.solve(output.value.transform.covariance, e)))
        fits = error_m <= LIMIT_M and error_deg <= LIMIT_DEG
        good, wrong = good + fits, wrong + (not fits)
    return {
        "seeds": [0, DEVON_TRIALS - 1], "within_2_cm_and_0.1_deg": interval(good, DEVON_TRIALS), "failed": failed,
        "wrong": interval(wrong, DEVON_TRIALS), "translation_m": spread(metres), "rotation_deg": spread(degrees),
        "mean_nees": round(float(np.mean(nees)), 2) if nees else None,
    }  # fmt: skip


def _off(T: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The truth with translation and rotation off, each uniform in size and in direction."""
    direction, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    R = se3.exp_so3(axis * np.deg2rad(rng.uniform(0, MAX_GUESS_DEG))) @ T[:3, :3]
    return se3.transform(R, T[:3, 3] + direction * rng.uniform(0, MAX_GUESS_M))


def _error(output: Output, T_true: FloatArray) -> dict[str, Any]:
    if output.quality.status is Status.FAILED:
        return {"status": "FAILED", "reasons": list(output.quality.reasons)}
    error_m, error_deg = pose_errors(output.value.transform.matrix, T_true)
    return {
        "status": str(output.quality.status), "translation_m": round(error_m, 5), "rotation_deg": round(error_deg, 5)
    }  # fmt: skip
