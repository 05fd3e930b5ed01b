# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate ``cdff calibrate extrinsics``: errors of mounts against their standard deviations.

Each drive is rover ``mana`` of ``rover_traverse`` on other terrain, along an S of 40 m, with slip, IMU, lidar
and stereo camera of the scenario, and other mounts. All motions are estimated from the simulated samples, as
the command does it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_core.calibration import DIRECTIONS
from cdff_dev.calibrate.extrinsics import calibrate
from cdff_dev.logs import open_log
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.store import make_log

ROBOT = "mana"
SEEDS = range(2000, 2012)
#: Seeds of the drives with a stereo camera, whose images cost most of the time.
CAMERA_SEEDS = range(2000, 2003)
_SENSORS = ("imu", "lidar", "navcam")
#: Standard deviations of the drawn mounts about those of the scenario: m, degrees.
_SHIFT_M, _TURN_DEG = 0.15, 10.0
_PATH = {
    "start_xy_m": [-6.0, -6.0],
    "curvature_1pm": [[0.0, 0.2], [9.0, 0.2], [11.0, -0.25], [20.0, -0.25], [22.0, 0.2], [40.0, 0.2]],
    "rest_before_s": 2.0,
}


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors and standard deviations of each direction of each sensor over all drives."""
    results_by_sensor: dict[str, list[tuple[FloatArray, FloatArray, tuple[str, ...]]]] = {
        name: [] for name in _SENSORS
    }
    refused = dict.fromkeys(_SENSORS, 0)
    scales: list[tuple[float, float]] = []
    for seed in SEEDS:
        progress(f"extrinsic calibration: seed {seed}")
        scenario = scenario_of(seed)
        truth = {"imu": scenario.imu.mount.matrix(), "lidar": scenario.lidar.mount.matrix()}
        if scenario.navcam is not None:
            truth["navcam"] = scenario.navcam.T_base_left
        with tempfile.TemporaryDirectory() as folder:
            make_log(scenario, Path(folder) / "log", workers=0)
            result = calibrate(open_log(Path(folder) / "log"), ROBOT, {})
        for sensor in result.sensors:
            name = sensor.stream.split("/")[-1].split(".")[0]
            if sensor.mount is None:
                refused[name] += 1
                continue
            error = pose_error(truth[name], sensor.mount.transform.matrix)
            results_by_sensor[name].append((error, sensor.mount.sigma, sensor.mount.undetermined))
        if result.scales is not None:
            scales.append((result.scales.radius, result.scales.radius_sigma))
    return {
        "drives": {name: len(entries) + refused[name] for name, entries in results_by_sensor.items()},
        "sensors": {name: _directions(entries) for name, entries in results_by_sensor.items()},
        "refused": refused,
        "wheel_radius": [[round(value, 4) for value in pair] for pair in scales],
    }


def scenario_of(seed: int) -> Scenario:
    """Return the drive of a seed: one rover, other terrain and mounts."""
    data = load_scenario("rover_traverse", seed).model_dump()
    rng = np.random.default_rng(seed)
    for sensor in _SENSORS:
        mount = data[sensor]["mount"]
        mount["xyz_m"] = [float(v) for v in mount["xyz_m"] + rng.normal(0.0, _SHIFT_M, 3)]
        mount["rpy_deg"] = [float(v) for v in mount["rpy_deg"] + rng.normal(0.0, _TURN_DEG, 3)]
    if seed not in CAMERA_SEEDS:
        data["navcam"], data["terrain"]["surface"] = None, None
    data["robots"] = {ROBOT: data["robots"][ROBOT] | _PATH}
    data["duration_s"] = 100.0
    return Scenario.model_validate(data)


def _directions(entries: Sequence[tuple[FloatArray, FloatArray, tuple[str, ...]]]) -> dict[str, Any]:
    """Return the figures of each direction over the drives that determine it."""
    directions = {}
    for k, name in enumerate(DIRECTIONS):
        scale = 1.0 if k < 3 else float(np.rad2deg(1.0))
        pairs = np.array([(e[k], s[k]) for e, s, missing in entries if name not in missing]).reshape(-1, 2)
        directions[name] = {"determined": len(pairs)}
        if len(pairs):
            ratio = pairs[:, 0] / pairs[:, 1]
            directions[name] |= {
                "rms": float(np.sqrt(np.mean(pairs[:, 0] ** 2))) * scale,
                "sigma": float(np.median(pairs[:, 1])) * scale,
                "squared_error": float(np.mean(ratio**2)),
                "largest": float(np.abs(ratio).max()),
            }
    return directions


def table(figures: dict[str, Any]) -> str:
    """Return the table of the directions."""
    lines = [
        "| sensor | direction | drives that determine the direction | RMS error | stated σ, median "
        "| mean NEES (1 expected) | largest error |",
        "|---|---|---|---|---|---|---|",
    ]
    for sensor, directions in figures["sensors"].items():
        for name, row in directions.items():
            cells = f"{row['determined']} of {figures['drives'][sensor]}"
            unit, digits = ("m", 3) if name in "xyz" else ("°", 2)
            if row["determined"]:
                cells += f" | {row['rms']:.{digits}f} {unit} | {row['sigma']:.{digits}f} {unit}"
                cells += f" | {row['squared_error']:.2f} | {row['largest']:.1f} σ"
            else:
                cells += " | – | – | – | –"
            lines.append(f"| {sensor} | {name} | {cells} |")
    return "\n".join(lines)
