# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare the motions of visual odometry between stereo pairs of EuRoC V1_01 with their covariance (real).

No parameter of the covariance was chosen on this set. The motion of each pair to the next one is estimated
alone. The NEES is ``e^T (P + R)^-1 e`` with the error ``e`` (6,) of ``pose_error``, the stated
covariance P and the covariance R of the reference; 6 is expected, 3 for translation or rotation alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.registry import Registry
from evaluation.data_sets import euroc
from evaluation.visual_odometry_disturbances import NOISE_ONLY

#: Page that contains the table of this evaluation.
PAGE = "visual_odometry_sparse"
#: Longest time between two pairs, seconds; later pairs have few points in common.
_MAX_GAP_S = 2.0
#: Standard deviations of one reference pose: rotation from the README of the set, position by Vicon.
_REFERENCE_RAD, _REFERENCE_M = float(np.radians(0.15)), 0.002
_BUDGETS: dict[str, dict[str, Any] | None] = {"with the error budget": None, "noise only": NOISE_ONLY}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the NEES with and without the error budget."""
    views = euroc.stereo_views(data / euroc.FOLDER)
    motions = [(a, b) for a, b in pairwise(views) if b.stamp_s - a.stamp_s < _MAX_GAP_S]
    results = {}
    for name, parameters in _BUDGETS.items():
        progress(f"visual odometry: EuRoC, {len(motions)} motions, {name}")
        rows = [_squared_errors(a, b, parameters) for a, b in motions]
        results[name] = _combine(rows)
    lengths_m = [float(np.linalg.norm(_true_motion(a, b)[:3, 3])) for a, b in motions]
    return {
        "data": euroc.FOLDER,
        "motions": len(motions),
        "length_median_m": round(float(np.median(lengths_m)), 3),
        "results": results,
    }


def _true_motion(a: euroc.StereoView, b: euroc.StereoView) -> FloatArray:
    return np.asarray(se3.inverse(a.T_world_left) @ b.T_world_left)


def _squared_errors(
    first: euroc.StereoView, second: euroc.StereoView, parameters: dict[str, Any] | None
) -> dict[str, Any]:
    """Return the status, and the NEES of the pose, its translation and its rotation."""
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(parameters, DfpcContext(robot="euroc"))
    outputs: list[Output] = []
    for i, view in enumerate((first, second)):
        outputs += dfpc.step(Sample("stereo", view.pair.stamp_ns, i, view.pair, id=str(i)))
    output = outputs[-1]
    row: dict[str, Any] = {"status": output.quality.status.value}
    if output.value is None:
        return row
    T, truth = output.value.transform, _true_motion(first, second)
    error = cov.pose_error(truth, T.matrix)
    total = T.covariance + _covariance_of_reference(truth)
    parts = {"pose": slice(0, 6), "translation": slice(0, 3), "rotation": slice(3, 6)}
    return row | {
        name: float(error[part] @ np.linalg.solve(total[part, part], error[part]))
        for name, part in parts.items()
    }


def _covariance_of_reference(T: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of the true motion T due to the errors of both reference poses.

    The rotation error of the first pose rotates the translation of the motion.
    """
    covariance = np.diag([2.0 * _REFERENCE_M**2] * 3 + [2.0 * _REFERENCE_RAD**2] * 3)
    lever = se3.skew(T[:3, 3])
    covariance[:3, :3] += _REFERENCE_RAD**2 * lever @ lever.T
    covariance[:3, 3:] = -(_REFERENCE_RAD**2) * lever
    covariance[3:, :3] = covariance[:3, 3:].T
    return np.asarray(covariance)


def _combine(rows: list[dict[str, Any]]) -> dict[str, Any]:
    located = [row for row in rows if row["status"] == "OK"]
    result: dict[str, Any] = {"status": dict(Counter(row["status"] for row in rows))}
    for part in ("pose", "translation", "rotation"):
        values = np.array([row[part] for row in located])
        result[part] = {
            "mean": round(float(values.mean()), 2),
            "median": round(float(np.median(values)), 2),
            "largest": round(float(values.max()), 1),
        }
    return result


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each budget."""
    lines = [
        f"**EuRoC V1_01 (real)**, {figures['motions']} motions of {figures['length_median_m']} m in "
        "the median; NEES of the OK outputs: mean (median, largest).",
        "",
        "| covariance | OK, DEGRADED, FAILED | pose (6 expected) | translation (3) | rotation (3) |",
        "|---|---|---|---|---|",
    ]
    for name, row in figures["results"].items():
        counts = ", ".join(str(row["status"].get(status, 0)) for status in ("OK", "DEGRADED", "FAILED"))
        parts = [
            f"{row[part]['mean']} ({row[part]['median']}, {row[part]['largest']})"
            for part in ("pose", "translation", "rotation")
        ]
        lines.append(f"| {name} | {counts} | {' | '.join(parts)} |")
    return "\n".join(lines)
