# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate the position manager on simulated traverses: end error and NEES for each set of sources.

The anchor and the mounts are exact, so that the results contain only errors of the estimate. Two parts:

- The frozen scenario ``rover_traverse`` with its images and sweeps. A trial is a seed of the visual odometry;
  the drive, its images, its sweeps and the errors of wheels and IMU have a fixed seed.
- Drives simulated at measurement level (``runs.dead_reckoning``). Each seed has different terrain, path and
  sensor errors. The NEES is computed on the ``HELD_OUT`` seeds; parameters were chosen with ``TRAINING``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product
from cdff_dev.compare.error_summary import error_summary
from evaluation.chart import Panel, chart
from evaluation.runs.consistency import consistency
from evaluation.runs.traverse import (
    EXACT_MOUNTS,
    SCENARIO,
    TraverseRun,
    lidar_slam,
    normalised_error,
    run,
    traverse_runs,
    visual_odometry,
)

SEEDS = range(3)
WHEELS_AND_IMU = {"wheels.odometry": "odometry", "imu.sample": "imu"}
#: Name of a set of sources -> (True if wheels and IMU are used, function that returns True if visual odometry
#: is available at a time, seconds from the start).
SOURCES: dict[str, tuple[bool, Callable[[float], bool]]] = {
    "wheels, imu, visual odometry": (True, lambda _t: True),
    "the same, no visual odometry from 10 s to 20 s": (True, lambda t: not 10.0 <= t < 20.0),
    "the same, visual odometry from 8 s on": (True, lambda t: t >= 8.0),
    "wheels, imu": (True, lambda _t: False),
    "visual odometry alone": (False, lambda _t: True),
}


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the end errors relative to the path length and the NEES, per rover and set of sources."""
    scenario_seed, drives = traverse_runs()
    report: dict[str, Any] = {"data": f"{SCENARIO} (simulated)", "scenario_seed": scenario_seed}
    report["seeds"] = [SEEDS.start, SEEDS.stop - 1]
    for drive in drives:
        report[drive.robot] = _evaluate_drive(drive, progress)
        drive.log.close()
    report["measurement level"] = consistency(progress)
    return report


def _evaluate_drive(drive: TraverseRun, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results of one rover."""
    measured = drive.samples(WHEELS_AND_IMU)
    percent: dict[str, list[float]] = {name: [] for name in SOURCES}
    nees: dict[str, list[float]] = {name: [] for name in SOURCES}
    visual: dict[str, list[float]] = {
        "end_error_m": [],
        "end_error_percent": [],
        "nees": [],
        "disparity_offset_px": [],
    }
    pairs = degraded = 0
    for seed in SEEDS:
        progress(f"position manager: {drive.robot}, seed {seed}")
        vo_poses = visual_odometry(drive, seed)
        pairs += len(vo_poses)
        degraded += sum(p.header.quality.status != "OK" for p in vo_poses)
        error_m, squared = _visual_error(drive, vo_poses)
        offset_px = abs(vo_poses[-1].header.quality.metrics["disparity_offset_px"])
        for key, value in zip(
            visual, (error_m, 100 * error_m / drive.path_length_m, squared, offset_px), strict=True
        ):
            visual[key].append(value)
        for name, (has_wheels_and_imu, has_vision) in SOURCES.items():
            if seed != SEEDS.start and not has_vision(0.0) and not has_vision(1e9):
                continue  # the seed has no effect without visual odometry
            ratio, squared = _error(
                drive,
                [*(measured if has_wheels_and_imu else []), *_as_samples(drive, vo_poses, has_vision)],
            )
            percent[name].append(100 * ratio)
            nees[name].append(squared)
    lidar_samples = {
        port: [Sample(port, p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality) for p in result]
        for port, result in (
            ("fix", lidar_slam(drive, "pose")),
            ("lidar_odometry", lidar_slam(drive, "odometry")),
        )
    }
    for name, samples in (
        ("wheels, imu, lidar_slam (its pose as fix)", lidar_samples["fix"]),
        (
            "wheels, imu, visual odometry, lidar_slam",
            [*lidar_samples["fix"], *_as_samples(drive, vo_poses, lambda _t: True)],
        ),
        ("wheels, imu, increments of lidar_slam's odometry", lidar_samples["lidar_odometry"]),
    ):
        ratio, squared = _error(drive, [*measured, *samples])
        percent[name], nees[name] = [100 * ratio], [squared]
    return {
        "path_length_m": round(drive.path_length_m, 3),
        "visual_odometry_sparse": {
            "poses": pairs,
            "not_ok": degraded,
            **{key: error_summary(values) for key, values in visual.items()},
        },
        "position_manager": {
            name: {"end_error_percent": error_summary(percent[name]), "nees": error_summary(nees[name])}
            for name in percent
        },
    }


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: end errors and NEES of the measurement-level drives, as SVG."""
    level = figures["measurement level"]
    names = list(level["position_manager"])
    peers = {"position_manager": level["position_manager"], "gtsam smoother": level["gtsam"]}
    errors = {
        method: [
            (e["median"], e["min"], e["p95"]) if (e := result.get(n, {}).get("end_error_percent")) else None
            for n in names
        ]
        for method, result in peers.items()
    }
    squared = {
        method: [(m, m, m) if (m := result.get(n, {}).get("mean_nees")) else None for n in names]
        for method, result in peers.items()
    }
    return chart(
        [
            Panel("end error, % of path length: median, minimum to 95 %", names, errors, 2.5),
            Panel("mean NEES, 95 % band grey", names, squared, 12.0, tuple(level["band"])),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the tables of both parts."""
    level = figures["measurement level"]
    robots = [r for r in ("mana", "minnie") if r in figures]
    lines = [
        f"| simulated traverse with images and sweeps, median | {' | '.join(robots)} |",
        "|---" * (len(robots) + 1) + "|",
    ]
    for name in figures[robots[0]]["position_manager"]:
        cells = [
            f"{row['end_error_percent']['median']:.2f} %, {row['nees']['median']:.1f}"
            for row in (figures[r]["position_manager"][name] for r in robots)
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    low, high = level["band"]
    lines += [
        "",
        "Each cell: error of the last position relative to the path length, NEES (6 expected).",
        "",
        f"| {level['drives']} held-out drives of {level['path_length_m']:.0f} m | error, median | 95 % | "
        f"largest | mean NEES (95 % band {low:.2f} to {high:.2f}) |",
        "|---|---|---|---|---|",
    ]
    for method in ("position_manager", "gtsam"):
        for name, row in level[method].items():
            errors = " | ".join(f"{row['end_error_percent'][key]:.2f} %" for key in ("median", "p95", "max"))
            drive_count = "" if row["drives"] == level["drives"] else f" ({row['drives']} drives)"
            lines.append(f"| {method}: {name}{drive_count} | {errors} | {row['mean_nees']:.2f} |")
    return "\n".join(lines)


def _as_samples(
    drive: TraverseRun, vo_poses: list[Product], has_vision: Callable[[float], bool]
) -> list[Sample]:
    """Return the poses of visual odometry at the available times, as samples for the position manager."""
    first_ns = min(drive.truth)
    return [
        Sample("visual_odometry", p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality)
        for p in vo_poses
        if has_vision((p.header.t1_ns - first_ns) * 1e-9)
    ]


def _error(drive: TraverseRun, samples: list[Sample]) -> tuple[float, float]:
    """Return the error of the last position relative to the path length, and the NEES of the last pose."""
    last = run("position_manager", drive.context, samples, parameters=EXACT_MOUNTS)[-1]
    error_m, squared = normalised_error(drive.true_pose(last.header.t1_ns), last.value.transform)
    return error_m / drive.path_length_m, squared


def _visual_error(drive: TraverseRun, vo_poses: list[Product]) -> tuple[float, float]:
    """Return the error of the camera motion from the first to the last pose, metres, and its NEES."""
    T_base_left = drive.context.frames.lookup(
        f"{drive.robot}/base", f"{drive.robot}/navcam_left", vo_poses[0].header.t1_ns
    ).matrix
    T_site_first, T_site_last = (
        drive.true_pose(p.header.t1_ns) @ T_base_left for p in (vo_poses[0], vo_poses[-1])
    )
    start: UncertainTransform = vo_poses[0].value.transform
    estimate: UncertainTransform = vo_poses[-1].value.transform
    return normalised_error(start.matrix @ se3.inverse(T_site_first) @ T_site_last, estimate)
