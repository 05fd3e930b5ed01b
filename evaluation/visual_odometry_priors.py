# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate visual odometry on every third pair of the frozen traverses, with and without wheels and gyro.

Each combination runs twice: with the defaults, and with a descriptor test that refuses all matches, so that
points are found by prediction only.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_dev.compare.error_summary import error_summary
from evaluation.runs.traverse import SIMULATED_CAMERA, TraverseRun, normalised_error, run, traverse_runs
from evaluation.runs.visual_traverses import SCENARIOS

#: Page that contains the table of this evaluation.
PAGE = "visual_odometry_sparse"

#: Every third pair is used.
EVERY = 3
#: Streams other than the images, and their ports.
PRIORS: dict[str, dict[str, str]] = {
    "none": {},
    "wheels": {"wheels.odometry": "odometry"},
    "gyro": {"imu.sample": "imu"},
    "wheels and gyro": {"wheels.odometry": "odometry", "imu.sample": "imu"},
}
SEARCHES: dict[str, dict[str, Any]] = {"by descriptors": {}, "none": {"matching": {"max_ratio": 1e-6}}}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results by motion prior and by the search for lost points."""
    rows: dict[str, dict[str, list[dict[str, Any]]]] = {
        prior: {search: [] for search in SEARCHES} for prior in PRIORS
    }
    seeds = []
    for name in SCENARIOS:
        seed, drives = traverse_runs(name)
        seeds.append(seed)
        for drive in drives:
            progress(f"visual odometry: {name}, {drive.robot}, every third pair")
            for prior, streams in PRIORS.items():
                for search, parameters in SEARCHES.items():
                    rows[prior][search].append(track_drive(drive, streams, parameters))
    return {
        "scenarios": list(SCENARIOS),
        "seeds": sorted(set(seeds)),
        "every": EVERY,
        "priors": {
            prior: {search: _summary(drives) for search, drives in row.items()} for prior, row in rows.items()
        },
    }


def track_drive(drive: TraverseRun, streams: dict[str, str], parameters: dict[str, Any]) -> dict[str, Any]:
    """Return pair counts by status, the fractions of tracked points and the end error of one drive."""
    images = drive.samples({"navcam.pair": "stereo"})[::EVERY]
    samples = images + (drive.samples(streams) if streams else [])
    result = run("visual_odometry_sparse", drive.context, samples, parameters=SIMULATED_CAMERA | parameters)
    T_base_left = drive.context.frames.lookup(f"{drive.robot}/base", f"{drive.robot}/navcam_left", 0).matrix
    T_site_first, T_site_last = (
        drive.true_pose(p.header.t1_ns) @ T_base_left for p in (result[0], result[-1])
    )
    tracked_fractions = [
        p.header.quality.metrics["tracked"] / max(p.header.quality.metrics["visible"], 1.0)
        for p in result
        if "tracked" in p.header.quality.metrics
    ]
    return {
        "pairs": len(images),
        "failed": len(images) - len(result),
        "degraded": sum(bool(p.header.quality.reasons) for p in result),
        "tracked_fractions": tracked_fractions,
        "end_percent": 100.0
        * normalised_error(se3.inverse(T_site_first) @ T_site_last, result[-1].value.transform)[0]
        / drive.path_length_m,
        "is_complete": result[-1].header.t1_ns == images[-1].stamp_ns,
    }


def _summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the results over all drives; end errors only of drives that were tracked to the last pair."""
    tracked_fractions = [fraction for row in rows for fraction in row["tracked_fractions"]]
    return {
        "drives": len(rows),
        "pairs": sum(row["pairs"] for row in rows),
        "failed": sum(row["failed"] for row in rows),
        "degraded": sum(row["degraded"] for row in rows),
        "points_found": round(float(np.median(tracked_fractions)), 3),
        "completed_drives": sum(row["is_complete"] for row in rows),
        "end_error_percent": error_summary([row["end_percent"] for row in rows if row["is_complete"]]),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table of results by motion prior."""
    lines = [
        f"| motion prior, every {figures['every']}rd pair | search for lost points | FAILED, DEGRADED "
        "| points found, median | drives tracked to the end | end error of these drives, median / maximum |",
        "|---|---|---|---|---|---|",
    ]
    for prior, searches in figures["priors"].items():
        for search, row in searches.items():
            e = row["end_error_percent"]
            error = f"{e['median']:.3f} / {e['max']:.3f} %" if e["count"] else ""
            lines.append(
                f"| {prior} | {search} | {row['failed']}, {row['degraded']} of {row['pairs']} "
                f"| {100.0 * row['points_found']:.0f} % | {row['completed_drives']} of {row['drives']} | {error} |"
            )
    return "\n".join(
        [*lines, "", f"{', '.join(figures['scenarios'])}, seed {', '.join(map(str, figures['seeds']))}."]
    )
