# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry over the frozen traverses with key frames located against one, two or three before them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_dev.evaluate._visual_traverses import SCENARIOS, judged_way
from cdff_dev.evaluate.record import spread
from cdff_dev.evaluate.traverse import drives, run
from cdff_dev.registration.rates import nees_band

#: Its page and what else is there are those of this evaluation.
PAGE = "visual_odometry_sparse"

WINDOWS = (1, 2, 3)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """End errors, and squared errors by covariance, of each window."""
    ends: dict[int, list[float]] = {window: [] for window in WINDOWS}
    nees: dict[int, list[float]] = {window: [] for window in WINDOWS}
    seeds = set()
    for name in SCENARIOS:
        seed, found = drives(name)
        seeds.add(seed)
        for drive in found:
            images = drive.samples({"navcam.pair": "stereo"})
            for window in WINDOWS:
                progress(f"visual odometry: {name}, {drive.robot}, window of {window}")
                poses = run("visual_odometry_sparse", drive.context, images, parameters={"window": window})
                error_m, squared = judged_way(drive, poses)
                ends[window].append(100.0 * error_m / drive.way_m)
                nees[window].append(squared)
    return {
        "scenarios": list(SCENARIOS),
        "seeds": sorted(seeds),
        "windows": {
            str(window): {
                "drives": len(ends[window]),
                "end_error_percent": spread(ends[window]),
                "mean_nees": round(float(np.mean(nees[window])), 2),
            }
            for window in WINDOWS
        },
    }


def table(figures: dict[str, Any]) -> str:
    """A row by window."""
    lines = [
        f"| window ({', '.join(figures['scenarios'])}, seed {', '.join(map(str, figures['seeds']))}) | drives "
        "| end error, median / worst | mean squared error |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {window} | {row['drives']} | {row['end_error_percent']['median']:.3f} / "
        f"{row['end_error_percent']['max']:.3f} % | {row['mean_nees']:.2f} |"
        for window, row in figures["windows"].items()
    ]
    count = figures["windows"][str(WINDOWS[0])]["drives"]
    low, high = nees_band(count)
    lines += ["", f"The mean of {count} consistent squared errors lies between {low:.2f} and {high:.2f} in 95 %."]
    return "\n".join(lines)
