# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate the position manager on skid-steered rovers: a real drive evaluated by GPS, and simulated drives.

The filter is compared with the pose stated by the wheels, and with their speed integrated along the gyro's
heading. Errors of position are RMS after the best rotation and translation in the plane.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_core.dfpcs.position_manager.compound import PositionManager
from evaluation.data_sets import husky
from evaluation.real import RealRow
from evaluation.runs import skid_steering
from evaluation.runs.planar_errors import aligned_error_m, speed_and_gyro, wheel_positions

#: Seeds with which no parameter was chosen; with the further ones only wheels and IMU are evaluated.
SEEDS, FURTHER_SEEDS = range(5, 8), range(30, 40)
#: Page with the table.
PAGE = "position_manager"
#: Name -> ports of the position manager.
WITH_IMU = {"wheels, imu": ("odometry", "imu")}
SETS = {"wheels alone": ("odometry",), **WITH_IMU}
WITH_CAMERA = {"wheels, imu, visual odometry": ("odometry", "imu", "visual_odometry")}
#: Ratio of errors from which a method is counted as worse.
_WORSE = 1.05
#: Interval of the three positions whose triangle is compared with GPS.
_TRIANGLE_NS = 20_000_000_000


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors of the real drive and of the simulated ones."""
    progress("position manager: Husky")
    report: dict[str, Any] = {"husky": evaluate_drive(husky.read_drive(data / husky.FILE), SETS)}
    report |= {"data": husky.FILE, "seeds": [*SEEDS, *FURTHER_SEEDS]}
    trials = []
    for seed in (*SEEDS, *FURTHER_SEEDS):
        progress(f"position manager: skid-steered rover, seed {seed}")
        sets = {**SETS, **WITH_CAMERA} if seed in SEEDS else WITH_IMU
        trials.append(evaluate_drive(skid_steering.simulate_drive(seed), sets))
    report["simulated"] = trials
    return report


def evaluate_drive(drive: husky.Drive, sets: dict[str, tuple[str, ...]]) -> dict[str, Any]:
    """Return RMS errors in metres by method, and mean NEES of triangles (3 expected) and refusals by set.

    ``triangle_nees_stated`` is the mean NEES with the variances of GPS that its driver states.
    """
    wheels, imu = drive.samples["odometry"], drive.samples["imu"]
    start_ns = wheels[0].stamp_ns
    t_s, imu_s = (np.array([s.stamp_ns - start_ns for s in k]) * 1e-9 for k in (wheels, imu))
    mount = drive.context.frames.lookup(f"{drive.context.robot}/base", f"{drive.context.robot}/imu", start_ns)
    yaw_rate = np.array([s.value.gyro for s in imu]) @ mount.matrix[2, :3]
    integrated = speed_and_gyro(t_s, drive.wheel_speed_m_s, imu_s, yaw_rate)
    errors = {
        "wheels' own pose": _error_m(drive, t_s, wheel_positions(wheels)),
        "wheel speed, gyro's yaw": _error_m(drive, t_s, integrated),
    }
    nees: dict[str, float] = {}
    nees_stated: dict[str, float] = {}
    refused: dict[str, int] = {}
    offsets: dict[str, dict[str, float]] = {}
    for name, ports in sets.items():
        node, refused[name] = run(drive, ports)
        trajectory = node.get_trajectory(-1, -1)
        estimate_s = (trajectory.stamps_ns - start_ns) * 1e-9
        errors[name] = _error_m(drive, estimate_s, trajectory.matrices[:, :2, 3])
        for means, variance_m2 in (
            (nees, drive.gps_variance_m2),
            (nees_stated, drive.gps_stated_variance_m2),
        ):
            means[name] = round(float(np.mean(triangle_nees(drive, node, variance_m2))), 2)
        offsets[name] = {port: round(value, 3) for port, value in node.stamps.applied_s.items() if value}
    degrees_of_freedom = 3 * len(triangle_nees(drive, node, drive.gps_variance_m2))
    band = chi2.ppf([0.025, 0.975], degrees_of_freedom) * 3 / degrees_of_freedom
    return {
        "error_m": {k: round(v, 3) for k, v in errors.items()},
        "triangle_nees": nees,
        "triangle_nees_stated": nees_stated,
        "triangle_band": [round(float(b), 2) for b in band],
        "refused": refused,
        "stamp_offset_s": offsets,
        "fastest_by_gps_m_s": round(_fastest_m_s(drive), 2),
        "fastest_by_wheels_m_s": round(float(np.max(drive.wheel_speed_m_s)), 2),
    }


def _fastest_m_s(drive: husky.Drive) -> float:
    """Return the largest mean speed over five seconds by GPS, which shows the size of its own errors."""
    t_s = (drive.gps_ns - drive.gps_ns[0]) * 1e-9
    later = np.searchsorted(t_s, t_s + 5.0)
    k = np.flatnonzero(later < len(t_s))
    steps = np.linalg.norm(drive.gps_m[later[k]] - drive.gps_m[k], axis=1)
    return float(np.max(steps / (t_s[later[k]] - t_s[k])))


def run(drive: husky.Drive, ports: tuple[str, ...]) -> tuple[PositionManager, int]:
    """Return a position manager with the default parameters after a drive, and its refused measurements."""
    node = Registry.default().make_dfpc("position_manager")
    assert isinstance(node, PositionManager)
    node.configure(None, drive.context)
    metrics: dict[str, float] = {}
    for sample in sorted((s for p in ports for s in drive.samples[p]), key=lambda s: (s.stamp_ns, s.port)):
        for output in node.step(sample):
            metrics = output.quality.metrics if output.port == "pose" else metrics
    return node, int(sum(value for key, value in metrics.items() if key.startswith("refused_")))


def _error_m(drive: husky.Drive, t_s: FloatArray, positions: FloatArray) -> float:
    gps_s = (drive.gps_ns - drive.samples["odometry"][0].stamp_ns) * 1e-9
    inside = (gps_s >= t_s[0]) & (gps_s <= t_s[-1])
    at_gps = np.column_stack([np.interp(gps_s[inside], t_s, column) for column in positions.T])
    return aligned_error_m(at_gps, drive.gps_m[inside])


def triangle_nees(drive: husky.Drive, node: PositionManager, gps_variance_m2: FloatArray) -> list[float]:
    """Return the squared errors of triangles of positions A, B, C, normalised by estimate and GPS.

    GPS gives no heading: the vectors from B to A and to C, in axes of the robot at B, are compared with those of
    GPS rotated by the angle that fits best. Their four components less this angle are 3 degrees of freedom.
    """
    stamps = drive.gps_ns
    first, last = stamps[0] + _TRIANGLE_NS, min(stamps[-1], drive.samples["odometry"][-1].stamp_ns)
    results = []
    for middle_ns in np.arange(first, last - _TRIANGLE_NS, 2 * _TRIANGLE_NS):
        a, b, c = (int(np.searchsorted(stamps, middle_ns + k * _TRIANGLE_NS)) for k in (-1, 0, 1))
        base = f"{drive.context.robot}/base"
        motions = [node.get_transform(base, int(stamps[b]), base, int(stamps[k])).transform for k in (a, c)]
        estimated = np.concatenate([m.matrix[:2, 3] for m in motions])
        truth = np.concatenate([drive.gps_m[k] - drive.gps_m[b] for k in (a, c)])
        C = np.zeros((4, 4))
        C[:2, :2], C[2:, 2:] = (np.asarray(m.covariance)[:2, :2] for m in motions)
        gps_a, gps_b, gps_c = (np.diag(gps_variance_m2[k]) for k in (a, b, c))
        C += np.kron(np.ones((2, 2)), gps_b)
        C[:2, :2] += gps_a
        C[2:, 2:] += gps_c
        results.append(_best_rotation(estimated, truth, C + 1e-8 * np.eye(4)))
    return results


def _best_rotation(estimated: FloatArray, truth: FloatArray, C: FloatArray) -> float:
    """Return the least normalised squared error over a rotation of the true vectors (2 vectors of 2)."""
    information = np.linalg.inv(C)

    def squared(angle: float) -> float:
        R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        residual = estimated - np.kron(np.eye(2), R) @ truth
        return float(residual @ information @ residual)

    grid = np.linspace(-np.pi, np.pi, 73)
    best = grid[int(np.argmin([squared(a) for a in grid]))]
    return float(minimize_scalar(squared, bounds=(best - 0.1, best + 0.1), method="bounded").fun)


def table(figures: dict[str, Any]) -> str:
    """Return the table of errors: the real drive, and means over the simulated ones."""
    simulated = figures["simulated"]
    lines = [
        "| RMS error of position | Husky, 147 m, by GPS | simulated drives of 400 s: mean, largest"
        " | worse than the wheels' own pose |",
        "|---|---|---|---|",
    ]
    for name in simulated[0]["error_m"]:
        real = figures["husky"]["error_m"].get(name)
        trials = [trial for trial in simulated if name in trial["error_m"]]
        errors_m, own_m = (
            np.array([trial["error_m"][k] for trial in trials]) for k in (name, "wheels' own pose")
        )
        nees = figures["husky"]["triangle_nees"].get(name)
        cell = "" if real is None else f"{real:.2f} m" + ("" if nees is None else f", NEES {nees:.1f}")
        squared = [trial["triangle_nees"][name] for trial in simulated if name in trial["triangle_nees"]]
        lines.append(
            f"| {name} | {cell} | {errors_m.mean():.2f} m, {errors_m.max():.2f} m"
            + (f", NEES {np.mean(squared):.1f}" if squared else "")
            + f" | {np.sum(errors_m > _WORSE * own_m)} of {len(trials)} |"
        )
    return "\n".join(lines)


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    error_m = figures["husky"]["error_m"]
    own_m, peer_m = error_m["wheels' own pose"], error_m["wheel speed, gyro's yaw"]
    return [
        RealRow(
            "Husky, 150 s, wheels and IMU, position RMS",
            "4.99 m",
            f"{error_m['wheels, imu']} m",
            f"wheel speed with the gyro's yaw {peer_m} m, wheels {own_m} m",
            f"≤ {peer_m} m",
        ),
        RealRow(
            "Husky, 150 s, wheels alone, position RMS",
            "112.2 m",
            f"{error_m['wheels alone']} m",
            f"wheels {own_m} m",
            f"≤ {1.1 * own_m:.2f} m",
        ),
        RealRow(
            "Husky, NEES of triangles against GPS (3 expected), with IMU / wheels alone",
            "",
            f"{_both_nees(figures, 'triangle_nees')}; with the square of GPS's dilution as its variance "
            f"{_both_nees(figures, 'triangle_nees_stated')}",
            "GPS measures up to {fastest_by_gps_m_s} m/s, wheels {fastest_by_wheels_m_s} m/s".format(
                **figures["husky"]
            ),
            "{} to {} (95 %)".format(*figures["husky"]["triangle_band"]),
        ),
    ]


def _both_nees(figures: dict[str, Any], key: str) -> str:
    """Return the mean NEES on the Husky with IMU and with wheels alone."""
    return " / ".join(str(figures["husky"][key][name]) for name in ("wheels, imu", "wheels alone"))
