# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare the errors of icp_localisation with the covariances it states, on real and on simulated clouds.

Each trial yields the NEES ``e^T C^-1 e``. Its mean is 6 if the covariance is correct, and
less if the covariance is too large.

Halves: the points of one real scan are divided into two random halves. One is the model, moved by 0.3 m and
2 degrees in a random direction; the truth is exact and no point is in both clouds. The halves share the
viewpoint, so that the result contains noise and sampling, but no difference between two views. Devon Island:
halves of the road and of its copy, with a guess 0.3 m and 2 degrees off.

Next scans: two successive scans, with the truth of the data set, whose own error (centimetres, 0.1 degrees)
is part of the NEES. Simulated scans: held-out seeds of ``icp_localisation``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from evaluation.data_sets.clouds import devon_halves, kitti_pair, small_gicp_pair
from evaluation.real import RealRow
from evaluation.record import squared_error
from evaluation.runs.icp import IMPLEMENTATIONS, localise, make_dfpc
from evaluation.scenes.terrain import scan_pair

#: Page that contains the table of this evaluation.
PAGE = "icp_localisation"

HALVES, SIMULATED_SEEDS = 6, range(3000, 3020)
STEP_M, STEP_DEG = 0.3, 2.0
#: Largest mean NEES of a set for a calibrated covariance.
LIMIT = 15.0
#: Mean NEES by implementation, in the order of ``IMPLEMENTATIONS``, before the covariances were revised for
#: real sensors; a record, which is not computed again.
_NEES_BEFORE = {
    "KITTI 94, halves": "0.9 / 1.5 / 11.8 / 4.5 / –",
    "Devon Island, halves": "1.8 / 0.3 / 44 / 81 / –",
}
#: Scene, model, true T_scene_model and guess.
Trial = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors and NEES of each implementation on each set."""
    dfpcs = {name: make_dfpc(name) for name in IMPLEMENTATIONS}
    results: dict[str, Any] = {}
    for name, (is_real, trials) in _sets(data).items():
        progress(f"icp_covariance: {name}")
        clouds = list(trials)
        results[name] = {"real": is_real} | {
            implementation: _summary([_run(dfpc, trial) for trial in clouds])
            for implementation, dfpc in dfpcs.items()
        }
    return {"limit": LIMIT, "sets": results, "real": _on_real_clouds(results)}


def _on_real_clouds(results: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the figures that ``cdff check`` reads, for each implementation with a calibrated covariance."""
    measured = {name: rows for name, rows in results.items() if rows["real"]}
    return {
        implementation: {
            name: squared_error(row["mean_nees"], 6, row["trials"] - row["refused"])
            for name, rows in measured.items()
            if "mean_nees" in (row := rows[implementation])
        }
        for implementation in IMPLEMENTATIONS
        if next(iter(measured.values()))[implementation].get("covariance_kind") == "calibrated"
    }


def halves(points_m: FloatArray, seed: int) -> Trial:
    """Return two random halves of a cloud, the second one moved, with the identity as guess."""
    rng = np.random.default_rng(seed)
    rows, count = rng.permutation(len(points_m)), len(points_m) // 2
    T = _displaced(np.eye(4), rng)
    return (
        points_m[rows[:count]],
        se3.transform_points(se3.inverse(T), points_m[rows[count:]]),
        T,
        np.eye(4),
    )


def _sets(data: Path) -> dict[str, tuple[bool, Iterator[Trial]]]:
    """Return by name of the set whether its clouds are measured, and its trials."""
    scans = {
        name: read_kitti_bin(data / "kitti_velodyne" / f"{name}.bin").points_m
        for name in ("000094", "000000")
    }
    return {
        "KITTI 94, halves": (True, _halves_of(scans["000094"])),
        "Devon Island, halves": (True, _devon(data)),
        "KITTI 000000, halves": (True, _halves_of(scans["000000"])),
        "small_gicp's target, halves": (True, _halves_of(small_gicp_pair(data)[1])),
        "KITTI 94→95": (True, _next_scan(kitti_pair(data))),
        "small_gicp's pair": (True, _next_scan(small_gicp_pair(data))),
        "simulated scans": (False, ((*scan_pair(seed), np.eye(4)) for seed in SIMULATED_SEEDS)),
    }


def _halves_of(points_m: FloatArray) -> Iterator[Trial]:
    return (halves(points_m.astype(np.float64), seed) for seed in range(HALVES))


def _devon(data: Path) -> Iterator[Trial]:
    for seed in range(HALVES):
        model, scene, T = devon_halves(data, seed)
        yield scene, model, T, _displaced(T, np.random.default_rng([seed, 1]))


def _next_scan(pair: tuple[FloatArray, FloatArray, FloatArray]) -> Iterator[Trial]:
    source, target, T = pair
    yield target, source, T, np.eye(4)


def _displaced(T: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return a pose moved by 0.3 m and 2 degrees in random directions."""
    direction, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    R = se3.exp_so3(np.radians(STEP_DEG) * axis) @ T[:3, :3]
    return se3.transform(R, T[:3, 3] + STEP_M * direction)


def _run(dfpc: Any, trial: Trial) -> tuple[float, float, float, str] | None:
    """Return the error, m, its stated standard deviation, m, the NEES and the covariance kind."""
    scene, model, T_true, guess = trial
    output, _ = localise(dfpc, scene, model, guess)
    if output.value is None:
        return None
    T = output.value.transform
    error, C = pose_error(T_true, T.matrix), T.covariance
    sigma_m = float(np.sqrt(np.trace(C[:3, :3])))
    kind = str(output.quality.covariance_kind)
    return float(np.linalg.norm(error[:3])), sigma_m, float(error @ np.linalg.solve(C, error)), kind


def _summary(rows: list[tuple[float, float, float, str] | None]) -> dict[str, Any]:
    answered = [row for row in rows if row is not None]
    if not answered:
        return {"trials": len(rows), "refused": len(rows)}
    error_m, sigma_m, squared, kinds = zip(*answered, strict=True)
    return {
        "trials": len(rows),
        "refused": len(rows) - len(answered),
        "max_error_m": round(max(error_m), 5),
        "mean_sigma_m": round(float(np.mean(sigma_m)), 5),
        "mean_nees": round(float(np.mean(squared)), 2),
        "max_nees": round(max(squared), 1),
        "covariance_kind": kinds[0],
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table of the NEES of all implementations on all sets."""
    names = " | ".join(f"`{i}`" for i in IMPLEMENTATIONS)
    lines = [
        f"| mean NEES (6 expected), largest error | {names} |",
        "|---" * (1 + len(IMPLEMENTATIONS)) + "|",
    ]
    for name, rows in figures["sets"].items():
        cells = [
            f"{rows[i]['mean_nees']}, {1e3 * rows[i]['max_error_m']:.1f} mm"
            if "mean_nees" in rows[i]
            else "–"
            for i in IMPLEMENTATIONS
        ]
        lines.append(f"| {name} ({rows[IMPLEMENTATIONS[0]]['trials']}) | {' | '.join(cells)} |")
    return "\n".join(lines)


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    return [
        RealRow(
            f"{name}, mean NEES (6 expected), {' / '.join(IMPLEMENTATIONS)}",
            nees_before,
            " / ".join(str(figures["sets"][name][i]["mean_nees"]) for i in IMPLEMENTATIONS),
            "",
            f"≤ {LIMIT:g}",
        )
        for name, nees_before in _NEES_BEFORE.items()
    ]
