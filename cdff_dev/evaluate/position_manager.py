# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Position manager and visual odometry on the simulated traverse: error at the end, by which sources there were.

The anchor and the mounts are known exactly, so that what is judged is the estimate. A trial is a seed of the visual
odometry; the drive, its images and the errors of wheels and IMU are those of the scenario's one seed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product
from cdff_dev.evaluate.record import spread
from cdff_dev.evaluate.traverse import SCENARIO, Drive, drives, normalised_error, run, visual_odometry

SEEDS = range(10)
FELT = {"wheels.odometry": "odometry", "imu.sample": "imu"}
#: Name of a set of sources -> (wheels and IMU, whether visual odometry is there at a time in seconds from the start).
SOURCES: dict[str, tuple[bool, Callable[[float], bool]]] = {
    "wheels, imu, visual odometry": (True, lambda _t: True),
    "the same, no visual odometry from 10 s to 20 s": (True, lambda t: not 10.0 <= t < 20.0),
    "the same, visual odometry from 8 s on": (True, lambda t: t >= 8.0),
    "wheels, imu": (True, lambda _t: False),
    "visual odometry alone": (False, lambda _t: True),
}


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Errors at the end as shares of the way, per rover and set of sources."""
    scenario_seed, found = drives()
    report: dict[str, Any] = {"data": f"{SCENARIO} (simulated)", "scenario_seed": scenario_seed}
    report["seeds"] = [SEEDS.start, SEEDS.stop - 1]
    for drive in found:
        report[drive.robot] = _drive(drive, progress)
        drive.log.close()
    return report


def _drive(drive: Drive, progress: Callable[[str], None]) -> dict[str, Any]:
    """Figures of one rover."""
    felt = drive.samples(FELT)
    percent: dict[str, list[float]] = {name: [] for name in SOURCES}
    nees: dict[str, list[float]] = {name: [] for name in SOURCES}
    visual: dict[str, list[float]] = {"end_error_m": [], "end_error_percent": [], "nees": [], "disparity_offset_px": []}
    pairs = doubted = 0
    for seed in SEEDS:
        progress(f"position manager: {drive.robot}, seed {seed}")
        seen = visual_odometry(drive, seed)
        pairs += len(seen)
        doubted += sum(p.header.quality.status != "OK" for p in seen)
        error_m, squared = _visual_error(drive, seen)
        offset_px = abs(seen[-1].header.quality.metrics["disparity_offset_px"])
        for key, value in zip(visual, (error_m, 100 * error_m / drive.way_m, squared, offset_px), strict=True):
            visual[key].append(value)
        for name, (has_felt, has_seen) in SOURCES.items():
            if seed != SEEDS.start and not has_seen(0.0) and not has_seen(1e9):
                continue  # nothing random is in it
            share, squared = _error(drive, [*(felt if has_felt else []), *_as_samples(drive, seen, has_seen)])
            percent[name].append(100 * share)
            nees[name].append(squared)
    return {
        "way_m": round(drive.way_m, 3),
        "visual_odometry_sparse": {
            "poses": pairs,
            "not_ok": doubted,
            **{key: spread(values) for key, values in visual.items()},
        },
        "position_manager": {
            name: {"end_error_percent": spread(percent[name]), "nees": spread(nees[name])} for name in SOURCES
        },
    }


def _as_samples(drive: Drive, seen: list[Product], has_seen: Callable[[float], bool]) -> list[Sample]:
    """Visual poses as samples of the position manager, as far as they are there."""
    first_ns = min(drive.truth)
    return [
        Sample("visual_odometry", p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality)
        for p in seen
        if has_seen((p.header.t1_ns - first_ns) * 1e-9)
    ]


def _error(drive: Drive, samples: list[Sample]) -> tuple[float, float]:
    """Error of the last position over the way, and its squared error by the stated covariance."""
    last = run("position_manager", drive.context, samples)[-1]
    error_m, squared = normalised_error(drive.true_pose(last.header.t1_ns), last.value.transform)
    return error_m / drive.way_m, squared


def _visual_error(drive: Drive, seen: list[Product]) -> tuple[float, float]:
    """The same of visual odometry: the camera's motion from its first pose to its last, metres and squared."""
    T_base_left = drive.context.frames.lookup(
        f"{drive.robot}/base", f"{drive.robot}/navcam_left", seen[0].header.t1_ns
    ).matrix
    first, last = (drive.true_pose(p.header.t1_ns) @ T_base_left for p in (seen[0], seen[-1]))
    start: UncertainTransform = seen[0].value.transform
    estimate: UncertainTransform = seen[-1].value.transform
    return normalised_error(start.matrix @ se3.inverse(first) @ last, estimate)
