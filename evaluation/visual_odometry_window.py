# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate visual odometry on the frozen traverses with windows of one, two and three keyframes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import nees_band
from evaluation.runs.traverse import run, traverse_runs
from evaluation.runs.visual_traverses import SCENARIOS, path_error

#: Page that contains the table of this evaluation.
PAGE = "visual_odometry_sparse"

WINDOWS = (1, 2, 3)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return end errors and NEES for each window size."""
    ends: dict[int, list[float]] = {window: [] for window in WINDOWS}
    nees: dict[int, list[float]] = {window: [] for window in WINDOWS}
    seeds = set()
    for name in SCENARIOS:
        seed, drives = traverse_runs(name)
        seeds.add(seed)
        for drive in drives:
            images = drive.samples({"navcam.pair": "stereo"})
            for window in WINDOWS:
                progress(f"visual odometry: {name}, {drive.robot}, window of {window}")
                poses = run("visual_odometry_sparse", drive.context, images, parameters={"window": window})
                error_m, squared = path_error(drive, poses)
                ends[window].append(100.0 * error_m / drive.path_length_m)
                nees[window].append(squared)
    return {
        "scenarios": list(SCENARIOS),
        "seeds": sorted(seeds),
        "windows": {
            str(window): {
                "drives": len(ends[window]),
                "end_error_percent": error_summary(ends[window]),
                "mean_nees": round(float(np.mean(nees[window])), 2),
            }
            for window in WINDOWS
        },
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each window size."""
    lines = [
        f"| window ({', '.join(figures['scenarios'])}, seed {', '.join(map(str, figures['seeds']))}) | "
        "drives | end error, median / maximum | mean NEES |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {window} | {row['drives']} | {row['end_error_percent']['median']:.3f} / "
        f"{row['end_error_percent']['max']:.3f} % | {row['mean_nees']:.2f} |"
        for window, row in figures["windows"].items()
    ]
    count = figures["windows"][str(WINDOWS[0])]["drives"]
    low, high = nees_band(count)
    lines += [
        "",
        f"95 % band of the mean NEES of {count} drives: {low:.2f} to {high:.2f}.",
    ]
    return "\n".join(lines)
