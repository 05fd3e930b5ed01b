# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Position manager on simulated traverses: error at the end by which sources there were, and consistency.

The anchor and the mounts are known exactly, so that what is judged is the estimate. Two parts:

- The frozen scenario ``rover_traverse`` with its images and sweeps: a trial is a seed of the visual odometry; the
  drive, its images, sweeps and the errors of wheels and IMU are those of the scenario's one seed.
- Drives simulated as measurements (``_dead_reckoning``), each with ground, way and all errors of its own: the squared
  error by the stated covariance over ``HELD_OUT`` seeds, of which none served to choose a parameter (``TRAINING`` did).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product
from cdff_dev.evaluate._chart import Panel, chart
from cdff_dev.evaluate._consistency import consistency
from cdff_dev.evaluate.record import spread
from cdff_dev.evaluate.traverse import SCENARIO, Drive, drives, lidar_slam, normalised_error, run, visual_odometry

SEEDS = range(3)
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
    report["measurement level"] = consistency(progress)
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
    swept = {
        port: [Sample(port, p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality) for p in found]
        for port, found in (("fix", lidar_slam(drive, "pose")), ("lidar_odometry", lidar_slam(drive, "odometry")))
    }
    for name, given in (
        ("wheels, imu, lidar_slam (its pose as fix)", swept["fix"]),
        ("wheels, imu, visual odometry, lidar_slam", [*swept["fix"], *_as_samples(drive, seen, lambda _t: True)]),
        ("wheels, imu, increments of lidar_slam's odometry", swept["lidar_odometry"]),
    ):
        share, squared = _error(drive, [*felt, *given])
        percent[name], nees[name] = [100 * share], [squared]
    return {
        "way_m": round(drive.way_m, 3),
        "visual_odometry_sparse": {
            "poses": pairs,
            "not_ok": doubted,
            **{key: spread(values) for key, values in visual.items()},
        },
        "position_manager": {
            name: {"end_error_percent": spread(percent[name]), "nees": spread(nees[name])} for name in percent
        },
    }


def draw(figures: dict[str, Any]) -> bytes:
    """Errors and squared errors of the measurement-level drives, each with its band."""
    level = figures["measurement level"]
    names = list(level["position_manager"])
    peers = {"position_manager": level["position_manager"], "gtsam smoother": level["gtsam"]}
    errors = {
        method: [
            (e["median"], e["min"], e["p95"]) if (e := found.get(n, {}).get("end_error_percent")) else None
            for n in names
        ]
        for method, found in peers.items()
    }
    squared = {
        method: [(m, m, m) if (m := found.get(n, {}).get("mean_nees")) else None for n in names]
        for method, found in peers.items()
    }
    return chart([
        Panel("error at the end, % of the way: median, least to 95 %", names, errors, 2.5),
        Panel("mean squared error by covariance, 95 % band grey", names, squared, 12.0, tuple(level["band"])),
    ])  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """Both parts as tables."""
    level = figures["measurement level"]
    robots = [r for r in ("mana", "minnie") if r in figures]
    lines = [
        f"| frozen traverse with its images and sweeps, median | {' | '.join(robots)} |",
        "|---" * (len(robots) + 1) + "|",
    ]
    for name in figures[robots[0]]["position_manager"]:
        cells = [
            f"{f['end_error_percent']['median']:.2f} %, {f['nees']['median']:.1f}"
            for f in (figures[r]["position_manager"][name] for r in robots)
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    low, high = level["band"]
    lines += [
        "",
        "Each: error of the last position over the way, squared error by the stated covariance (6 expected).",
        "",
        f"| {level['drives']} held-out drives of {level['way_m']:.0f} m | error, median | 95 % | largest "
        f"| mean squared error by covariance (band {low:.2f} to {high:.2f}) |",
        "|---|---|---|---|---|",
    ]
    for method in ("position_manager", "gtsam"):
        for name, f in level[method].items():
            shares = " | ".join(f"{f['end_error_percent'][key]:.2f} %" for key in ("median", "p95", "max"))
            fewer = "" if f["drives"] == level["drives"] else f" ({f['drives']} drives)"
            lines.append(f"| {method}: {name}{fewer} | {shares} | {f['mean_nees']:.2f} |")
    return "\n".join(lines)


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
