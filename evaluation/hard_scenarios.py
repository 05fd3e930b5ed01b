# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate visual odometry, lidar SLAM, position manager and elevation maps on sensors with simulated faults.

Each scenario is also simulated without its faults, on the same ground, which separates the effects of the
ground and of the faults. All parameters are defaults, except the range noise of the data sheet for the map.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from evaluation.runs.elevation import CONFIG
from evaluation.runs.hard_drives import (
    SCENARIOS,
    HardDrive,
    as_samples,
    elevation_scores,
    pose_scores,
    products,
    simulate_drive,
)

#: Parts of the evaluation: the scenarios, and the same scenarios without faults.
PARTS = ("faults", "controls")
_LABELS = {"faults": "yes", "controls": "no"}


def evaluate(data: Path, progress: Callable[[str], None], parts: tuple[str, ...] = PARTS) -> dict[str, Any]:
    """Return the results by part and scenario."""
    report: dict[str, Any] = {}
    for part in parts:
        for use, names in SCENARIOS.items():
            for name in names:
                progress(f"hard scenarios: {name}, {part}")
                drive = simulate_drive(name, with_faults=part == "faults")
                report.setdefault(part, {})[name] = {
                    "use": use,
                    "seed": drive.scenario.seed,
                    "path_length_m": round(drive.path_length_m, 2),
                    "compounds": evaluate_drive(drive),
                }
    return report


def evaluate_drive(drive: HardDrive) -> dict[str, Any]:
    """Return the results of each compound on one drive."""
    inputs = drive.samples
    proprioception = [*inputs["odometry"], *inputs["imu"]]
    visual = products("visual_odometry_sparse", drive, [*inputs["stereo"], *proprioception], "pose")
    slam = products("lidar_slam", drive, [*inputs["scan"], *inputs["odometry"]], "pose")
    dead_reckoning = products("position_manager", drive, proprioception, "pose")
    fused = products(
        "position_manager", drive, [*proprioception, *as_samples(visual, "visual_odometry")], "pose"
    )
    parameters = {**CONFIG, "range_sigma_m": drive.scenario.lidar.range_sigma_m}
    elevation = products(
        "digital_elevation_mapping",
        drive,
        [*inputs["scan"], *as_samples(fused, "poses")],
        "map",
        variant="Lidar",
        parameters=parameters,
    )
    return {
        "visual_odometry_sparse": pose_scores(drive, visual, "navcam_left"),
        "lidar_slam": pose_scores(drive, slam, "lidar"),
        "position_manager: wheels, imu": pose_scores(drive, dead_reckoning, None),
        "position_manager: wheels, imu, visual odometry": pose_scores(drive, fused, None),
        "digital_elevation_mapping": elevation_scores(drive, elevation),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the tables of poses and of elevation maps."""
    lines = [
        "| scenario | compound | faults | end error | RMS error | NEES (6 expected), end (median) "
        "| DEGRADED | FAILED | OK poses beyond 3 σ |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    maps = [
        "| scenario | faults | bias | RMSE | RMSE without shift and tilt | within the 90 % interval "
        "| DEGRADED, FAILED |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, scenario in figures["faults"].items():
        for compound in scenario["compounds"]:
            for part in (part for part in PARTS if part in figures):
                row = figures[part][name]
                result = row["compounds"][compound]
                if compound == "digital_elevation_mapping":
                    maps.append(f"| `{name}` | {_LABELS[part]} | {_map_cells(result)} |")
                else:
                    lines.append(
                        f"| `{name}`, {row['path_length_m']:.1f} m | {compound} | {_LABELS[part]} | "
                        f"{_pose_cells(result)} |"
                    )
    return "\n".join([*lines, "", *maps])


def _pose_cells(row: dict[str, Any]) -> str:
    flags = f"{100 * row['degraded']:.0f} % | {100 * row['failed']:.0f} %"
    if "end_error_m" not in row:
        return f"no pose | – | – | {flags} | –"
    squared = f"{_number(row['squared_error_end'])} ({_number(row['squared_error_median'])})"
    beyond = "–" if row["ok_beyond_3_sigma"] is None else f"{100 * row['ok_beyond_3_sigma']:.0f} %"
    return (
        f"{row['end_error_m']:.3f} m, {row['end_error_percent']:.2f} % | {row['rms_error_m']:.3f} m | "
        f"{squared} | {flags} | {beyond}"
    )


def _map_cells(row: dict[str, Any]) -> str:
    flags = f"{100 * row['degraded']:.0f} %, {100 * row['failed']:.0f} %"
    if "rmse_m" not in row:
        return f"no overlap with the terrain | – | – | – | {flags}"
    millimetres = " | ".join(
        f"{1e3 * row[name]:.0f} mm" for name in ("bias_m", "rmse_m", "rmse_without_shift_and_tilt_m")
    )
    return f"{millimetres} | {100 * row['within_90_percent']:.0f} % | {flags}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"
