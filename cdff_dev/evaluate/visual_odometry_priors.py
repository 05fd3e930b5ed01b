# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry that sees only every third pair of the frozen traverses, with and without wheels and gyro.

Each way of driving is looked at twice: as it is, and with descriptors that let nothing pass, so that only what was
predicted is found.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_dev.evaluate._visual_traverses import SCENARIOS
from cdff_dev.evaluate.record import spread
from cdff_dev.evaluate.traverse import Drive, drives, normalised_error, run

#: Its page and what else is there are those of this evaluation.
PAGE = "visual_odometry_sparse"

EVERY = 3
#: Streams beside the images, and the ports that they go to.
FELT: dict[str, dict[str, str]] = {
    "nothing": {},
    "wheels": {"wheels.odometry": "odometry"},
    "gyro": {"imu.sample": "imu"},
    "wheels and gyro": {"wheels.odometry": "odometry", "imu.sample": "imu"},
}
SEARCHES: dict[str, dict[str, Any]] = {"by descriptors": {}, "not": {"matching": {"max_ratio": 1e-6}}}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """What was followed of the drives, by what was felt and whether lost points may be searched for."""
    rows: dict[str, dict[str, list[dict[str, Any]]]] = {felt: {search: [] for search in SEARCHES} for felt in FELT}
    seeds = []
    for name in SCENARIOS:
        seed, found = drives(name)
        seeds.append(seed)
        for drive in found:
            progress(f"visual odometry: {name}, {drive.robot}, every third pair")
            for felt, streams in FELT.items():
                for search, parameters in SEARCHES.items():
                    rows[felt][search].append(followed(drive, streams, parameters))
    return {
        "scenarios": list(SCENARIOS),
        "seeds": sorted(set(seeds)),
        "every": EVERY,
        "felt": {felt: {search: _figures(of) for search, of in row.items()} for felt, row in rows.items()},
    }


def followed(drive: Drive, streams: dict[str, str], parameters: dict[str, Any]) -> dict[str, Any]:
    """One drive: its pairs, those without a pose or doubted, the share of points found, and the error at the end."""
    images = drive.samples({"navcam.pair": "stereo"})[::EVERY]
    samples = images + (drive.samples(streams) if streams else [])
    found = run("visual_odometry_sparse", drive.context, samples, parameters=parameters)
    T_base_left = drive.context.frames.lookup(f"{drive.robot}/base", f"{drive.robot}/navcam_left", 0).matrix
    first, last = (drive.true_pose(p.header.t1_ns) @ T_base_left for p in (found[0], found[-1]))
    shares = [
        p.header.quality.metrics["tracked"] / max(p.header.quality.metrics["visible"], 1.0)
        for p in found
        if "tracked" in p.header.quality.metrics
    ]
    return {
        "pairs": len(images),
        "failed": len(images) - len(found),
        "degraded": sum(bool(p.header.quality.reasons) for p in found),
        "shares": shares,
        "end_percent": 100.0 * normalised_error(se3.inverse(first) @ last, found[-1].value.transform)[0] / drive.way_m,
        "whole": found[-1].header.t1_ns == images[-1].stamp_ns,
    }


def _figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Of all drives; end errors of those that were followed to the last pair."""
    shares = [share for row in rows for share in row["shares"]]
    return {
        "drives": len(rows),
        "pairs": sum(row["pairs"] for row in rows),
        "failed": sum(row["failed"] for row in rows),
        "degraded": sum(row["degraded"] for row in rows),
        "points_found": round(float(np.median(shares)), 3),
        "to_the_end": sum(row["whole"] for row in rows),
        "end_error_percent": spread([row["end_percent"] for row in rows if row["whole"]]),
    }


def table(figures: dict[str, Any]) -> str:
    """What was followed, by what was felt."""
    lines = [
        f"| one pair of {figures['every']}, felt | lost points are searched | FAILED, DEGRADED "
        "| points found, median | followed to the end | end error of those, median / worst |",
        "|---|---|---|---|---|---|",
    ]
    for felt, searches in figures["felt"].items():
        for search, row in searches.items():
            e = row["end_error_percent"]
            error = f"{e['median']:.3f} / {e['max']:.3f} %" if e["count"] else ""
            lines.append(
                f"| {felt} | {search} | {row['failed']}, {row['degraded']} of {row['pairs']} "
                f"| {100.0 * row['points_found']:.0f} % | {row['to_the_end']} of {row['drives']} | {error} |"
            )
    return "\n".join([*lines, "", f"{', '.join(figures['scenarios'])}, seed {', '.join(map(str, figures['seeds']))}."])
