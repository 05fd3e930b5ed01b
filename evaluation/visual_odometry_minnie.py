# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare visual odometry with the recorded motion of the rover Minnie between two stereo pairs (real)."""

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
from evaluation.data_sets.minnie import FOLDER, pairs, recorded_step

#: Page that contains the table of this evaluation.
PAGE = "visual_odometry_sparse"

SCALES = (1.0, 0.5, 1 / 3)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the estimated step at each image size, the recorded step and its accuracy."""
    recorded = recorded_step(data / FOLDER)
    results = {}
    for scale in SCALES:
        stereo_pairs = pairs(data / FOLDER, scale)
        rows, columns = stereo_pairs[0].left.image.shape[:2]
        progress(f"visual odometry: Minnie, {columns} x {rows}")
        results[f"{columns} x {rows}"] = pose_of_second_pair(stereo_pairs)
    steps = [output.value.transform.matrix[:3, 3] for output in results.values()]
    direction, smallest_sigma_m, largest_sigma_m = most_precise_direction_of(recorded)
    return {
        "data": FOLDER,
        "recorded_step_mm": _mm(np.linalg.norm(recorded.matrix[:3, 3])),
        "recorded_sigma_mm": {
            "most_precise_direction": _mm(smallest_sigma_m),
            "least_precise_direction": _mm(largest_sigma_m),
        },
        "recorded_sigma_mrad": round(1e3 * float(np.sqrt(np.trace(recorded.covariance[3:, 3:]) / 3)), 2),
        "bounds_95": {
            "pose": round(float(chi2.ppf(0.95, 6)), 2),
            "rotation": round(float(chi2.ppf(0.95, 3)), 2),
        },
        "largest_difference_of_resolutions_mm": _mm(max(np.linalg.norm(a - b) for a in steps for b in steps)),
        "resolutions": {size: _row(output, recorded, direction) for size, output in results.items()},
    }


def pose_of_second_pair(stereo_pairs: list[FramePair]) -> Output:
    """Return the output for the second pair; raises InputError if it has no pose."""
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="minnie"))
    outputs = [
        o
        for i, p in enumerate(stereo_pairs)
        for o in dfpc.step(Sample("stereo", p.stamp_ns, i, p, id=str(i)))
    ]
    if outputs[-1].value is None:
        raise InputError(f"Minnie's second pair: {', '.join(outputs[-1].quality.reasons)}; expected a pose")
    return outputs[-1]


def squared_errors(recorded: UncertainTransform, estimate: FloatArray) -> tuple[float, float]:
    """Return the NEES of a step relative to the recorded covariance: of the pose (6 DoF), of the rotation
    (3).
    """
    error = cov.pose_error(recorded.matrix, estimate)
    return (
        float(error @ np.linalg.solve(recorded.covariance, error)),
        float(error[3:] @ np.linalg.solve(recorded.covariance[3:, 3:], error[3:])),
    )


def most_precise_direction_of(recorded: UncertainTransform) -> tuple[FloatArray, float, float]:
    """Return the direction (3,) of smallest variance of the recorded translation, and its smallest and
    largest standard deviation, metres.
    """
    variances, directions = np.linalg.eigh(recorded.covariance[:3, :3])
    return directions[:, 0], float(np.sqrt(variances[0])), float(np.sqrt(variances[-1]))


def _row(output: Output, recorded: UncertainTransform, direction: FloatArray) -> dict[str, Any]:
    T = output.value.transform
    error = cov.pose_error(recorded.matrix, T.matrix)
    pose_nees, rotation_nees = squared_errors(recorded, T.matrix)
    return {
        "status": output.quality.status.value,
        "step_mm": _mm(np.linalg.norm(T.matrix[:3, 3])),
        "sigma_mm": _mm(np.sqrt(np.linalg.eigvalsh(T.covariance[:3, :3])[-1])),
        "error_mm": _mm(np.linalg.norm(error[:3])),
        "error_in_most_precise_direction_mm": _mm(abs(direction @ error[:3])),
        "error_mrad": [round(1e3 * float(v), 2) for v in error[3:]],
        "nees_of_pose": round(pose_nees, 3),
        "nees_of_rotation": round(rotation_nees, 3),
    }


def _mm(metres: Any) -> float:
    return round(1e3 * float(metres), 2)


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each image size."""
    bounds, sigma = figures["bounds_95"], figures["recorded_sigma_mm"]
    lines = [
        f"| Minnie's step, {figures['recorded_step_mm']:.1f} mm recorded | estimate (1σ) | difference from the "
        f"record | difference along the direction of smallest recorded variance (σ "
        f"{sigma['most_precise_direction']:.0f} mm) | rotation difference | "
        "NEES of the pose | NEES of the rotation |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {size}, {row['status']} | {row['step_mm']:.1f} ({row['sigma_mm']:.1f}) mm | "
        f"{row['error_mm']:.1f} mm | {row['error_in_most_precise_direction_mm']:.1f} mm | "
        f"{', '.join(f'{v:+.2f}' for v in row['error_mrad'])} mrad | {row['nees_of_pose']:.2f} | "
        f"{row['nees_of_rotation']:.2f} |"
        for size, row in figures["resolutions"].items()
    ]
    lines += [
        "",
        f"NEES refers to the covariance of the record; its 95 % limits are {bounds['pose']} and "
        f"{bounds['rotation']}. The steps at these sizes differ by "
        f"{figures['largest_difference_of_resolutions_mm']:.2f} mm at most.",
    ]
    return "\n".join(lines)
