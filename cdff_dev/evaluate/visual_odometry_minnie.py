# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry on a step of the rover Minnie (real), judged by the covariance of its recorded poses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry import covariance as cov
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from cdff_dev.evaluate._minnie import FOLDER, pairs, recorded_step

#: Its page and what else is there are those of this evaluation.
PAGE = "visual_odometry_sparse"

SCALES = (1.0, 0.5, 1 / 3)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """The step at each resolution, against the record; how surely the record knows it."""
    recorded = recorded_step(data / FOLDER)
    found = {}
    for scale in SCALES:
        seen = pairs(data / FOLDER, scale)
        rows, columns = seen[0].left.image.shape[:2]
        progress(f"visual odometry: Minnie, {columns} x {rows}")
        found[f"{columns} x {rows}"] = located(seen)
    steps = [output.value.transform.matrix[:3, 3] for output in found.values()]
    best, sigma_best_m, sigma_worst_m = known_best(recorded)
    return {
        "data": FOLDER,
        "recorded_step_mm": _mm(np.linalg.norm(recorded.matrix[:3, 3])),
        "recorded_sigma_mm": {"best_known_direction": _mm(sigma_best_m), "least_known_direction": _mm(sigma_worst_m)},
        "recorded_sigma_mrad": round(1e3 * float(np.sqrt(np.trace(recorded.covariance[3:, 3:]) / 3)), 2),
        "bounds_95": {"pose": round(float(chi2.ppf(0.95, 6)), 2), "turn": round(float(chi2.ppf(0.95, 3)), 2)},
        "largest_difference_of_resolutions_mm": _mm(max(np.linalg.norm(a - b) for a in steps for b in steps)),
        "resolutions": {size: _row(output, recorded, best) for size, output in found.items()},
    }  # fmt: skip


def located(seen: list[FramePair]) -> Output:
    """What the DFPC says of the second pair; raises InputError where that is no pose."""
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="minnie"))
    outputs = [o for i, p in enumerate(seen) for o in dfpc.step(Sample("stereo", p.stamp_ns, i, p, id=str(i)))]
    if outputs[-1].value is None:
        raise InputError(f"Minnie's second pair: {', '.join(outputs[-1].quality.reasons)}; expected a pose")
    return outputs[-1]


def squared_errors(recorded: UncertainTransform, found: FloatArray) -> tuple[float, float]:
    """Squared error of a step by the record's covariance: of the pose (6 degrees of freedom), of the turn (3)."""
    error = cov.pose_error(recorded.matrix, found)
    return (
        float(error @ np.linalg.solve(recorded.covariance, error)),
        float(error[3:] @ np.linalg.solve(recorded.covariance[3:, 3:], error[3:])),
    )


def known_best(recorded: UncertainTransform) -> tuple[FloatArray, float, float]:
    """The direction (3,) in which the recorded step is known best, its sigma, and that of the worst, metres."""
    variances, directions = np.linalg.eigh(recorded.covariance[:3, :3])
    return directions[:, 0], float(np.sqrt(variances[0])), float(np.sqrt(variances[-1]))


def _row(output: Output, recorded: UncertainTransform, best: FloatArray) -> dict[str, Any]:
    T = output.value.transform
    error = cov.pose_error(recorded.matrix, T.matrix)
    whole, turn = squared_errors(recorded, T.matrix)
    return {
        "status": output.quality.status.value,
        "step_mm": _mm(np.linalg.norm(T.matrix[:3, 3])),
        "sigma_mm": _mm(np.sqrt(np.linalg.eigvalsh(T.covariance[:3, :3])[-1])),
        "off_mm": _mm(np.linalg.norm(error[:3])),
        "off_in_best_known_direction_mm": _mm(abs(best @ error[:3])),
        "off_mrad": [round(1e3 * float(v), 2) for v in error[3:]],
        "squared_error_of_pose": round(whole, 3),
        "squared_error_of_turn": round(turn, 3),
    }


def _mm(metres: Any) -> float:
    return round(1e3 * float(metres), 2)


def table(figures: dict[str, Any]) -> str:
    """The step by resolution."""
    bounds, sigma = figures["bounds_95"], figures["recorded_sigma_mm"]
    lines = [
        f"| Minnie's step, {figures['recorded_step_mm']:.1f} mm recorded | found (one sigma) | off the record "
        f"| in the direction that it knows to {sigma['best_known_direction']:.0f} mm | turned off "
        "| squared error of the pose | of its turn |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {size}, {row['status']} | {row['step_mm']:.1f} ({row['sigma_mm']:.1f}) mm | {row['off_mm']:.1f} mm "
        f"| {row['off_in_best_known_direction_mm']:.1f} mm | {', '.join(f'{v:+.2f}' for v in row['off_mrad'])} mrad "
        f"| {row['squared_error_of_pose']:.2f} | {row['squared_error_of_turn']:.2f} |"
        for size, row in figures["resolutions"].items()
    ]
    lines += [
        "",
        f"Squared errors are by the record's covariance; in 95 % they are below {bounds['pose']} and {bounds['turn']}. "
        f"The steps at these sizes differ by {figures['largest_difference_of_resolutions_mm']:.2f} mm at most.",
    ]
    return "\n".join(lines)
