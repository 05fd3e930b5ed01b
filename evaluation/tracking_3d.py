# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of bodies from their poses: simulated tumbles, a comet, and the target of a rendezvous.

The poses of the comet are those of the mission's navigation, those of the target are from a simulation of a
rendezvous; noise is added to both.
"""

from __future__ import annotations

import csv
import gzip
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.body_motion_estimation.interface import (
    BodyMotionEstimationInputs,
    BodyMotionEstimationOutputs,
)
from cdff_core.rigid_body.torque_free import TorqueFreeBody

#: Noise, interval of the poses and horizon of predictions.
SIGMA_M, SIGMA_DEG, INTERVAL_S, HORIZON_S = 0.005, 0.4, 5.0, 60.0
RATE_DEG_S = 0.7
#: Pole of comet 67P, degrees, and its period, hours (README of the data set).
POLE_DEG, PERIOD_H = (69.54, 64.11), 12.4042


def evaluate(data: Path, progress: Callable[[str], None], tumbles: int = 40) -> dict[str, Any]:
    """Return the results."""
    figures: dict[str, Any] = {"simulated_tumbles": simulated(tumbles, progress)}
    progress("tracking_3d: comet")
    figures["comet_67p"] = {f"{noise_deg} deg": comet(data, noise_deg) for noise_deg in (0.25, 0.5)}
    progress("tracking_3d: single axis")
    figures["rendezvous_roe1"] = {
        f"{n} poses from {start}": single_axis(data, start, n)
        for start, n in ((0, 150), (500, 300), (0, 1200))
    }
    return figures


def simulated(tumbles: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors of tumbles over two revolutions, seeds from 1000."""
    rows = []
    for seed in range(1000, 1000 + tumbles):
        progress(f"tracking_3d: tumble {seed}")
        rows.append(_tumble(seed))
    observable = [row for row in rows if row["ratio_error"] is not None]
    errors = np.array([row["ratio_error"] for row in observable])
    return {
        "tumbles": tumbles,
        "ratios_stated": len(observable),
        "ratio_error_percent": {"median": float(np.median(errors)), "largest": float(errors.max())},
        "ratios_within_2_percent": int((errors <= 2.0).sum()),
        "prediction_60_s_deg": _spread([row["prediction_deg"] for row in rows]),
        "position_60_s_mm": _spread([row["position_mm"] for row in rows]),
        "nees_pose_of_6": float(np.mean([row["nees_pose"] for row in rows])),
        "nees_prediction_of_6": float(np.mean([row["nees_prediction"] for row in rows])),
        "nees_velocity_of_6": float(np.mean([row["nees_velocity"] for row in rows])),
        "nees_95_percent": [
            6.0 - 1.96 * float(np.sqrt(12.0 / tumbles)),
            6.0 + 1.96 * float(np.sqrt(12.0 / tumbles)),
        ],
        "cpu_s_per_fit": float(np.median([row["cpu_s"] for row in rows])),
    }


def _tumble(seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    moments = np.sort(rng.uniform(0.5, 1.0, 3))
    axes = se3.exp_so3(rng.normal(size=3))
    rate = rng.normal(size=3)
    rate *= np.deg2rad(RATE_DEG_S) / np.linalg.norm(rate)
    body = TorqueFreeBody((axes * moments) @ axes.T, rate, se3.exp_so3(rng.normal(size=3)))
    centre, velocity = rng.normal(size=3) * 0.2, rng.normal(size=3) * 0.002
    t_s = np.arange(0.0, 2 * 360.0 / RATE_DEG_S, INTERVAL_S)
    queries_s = t_s[-1] + np.array([0.0, HORIZON_S])

    def poses(times_s: FloatArray) -> FloatArray:
        R = body.orientations(times_s)
        return se3.transform(R, np.outer(times_s, velocity) - R @ centre)

    started = time.process_time()
    motion = _estimate(t_s, _noisy(poses(t_s), np.deg2rad(SIGMA_DEG), rng), np.deg2rad(SIGMA_DEG), queries_s)
    cpu_s = time.process_time() - started
    truth = poses(queries_s)
    R = truth[:, :3, :3]
    rotation_errors = se3.log_so3(motion.poses[:, :3, :3] @ np.swapaxes(R, 1, 2))
    errors = np.concatenate([motion.poses[:, :3, 3] - truth[:, :3, 3], rotation_errors], axis=1)
    rates = (R @ body.rates(queries_s)[:, :, None])[:, :, 0]
    velocities = np.concatenate([velocity - np.cross(rates, R @ centre), rates], axis=1)
    error = motion.velocities[1] - velocities[1]
    true_ratios = moments[:2] / moments[2]
    return {
        "ratio_error": None
        if motion.moment_ratios is None
        else float(100.0 * np.abs(motion.moment_ratios / true_ratios - 1.0).max()),
        "prediction_deg": float(np.rad2deg(np.linalg.norm(rotation_errors[1]))),
        "position_mm": float(1e3 * np.linalg.norm(errors[1, :3])),
        "nees_pose": float(errors[0] @ np.linalg.solve(motion.covariances[0], errors[0])),
        "nees_prediction": float(errors[1] @ np.linalg.solve(motion.covariances[1], errors[1])),
        "nees_velocity": float(error @ np.linalg.solve(motion.velocity_covariances[1], error)),
        "cpu_s": cpu_s,
    }


def comet(data: Path, noise_deg: float) -> dict[str, Any]:
    """Return errors of axis and period of comet 67P from its poses with noise."""
    with (data / "rosetta_67p" / "truth.csv").open() as file:
        rows = sorted(csv.DictReader(file), key=lambda row: float(row["unix_s"]))

    def columns(*names: str) -> FloatArray:
        return np.array([[float(row[name]) for name in names] for row in rows])

    R_camera_body = se3.matrix_from_quaternion_xyzw(columns("qx", "qy", "qz", "qw"))
    R_inertial_camera = se3.matrix_from_quaternion_xyzw(columns("iqx", "iqy", "iqz", "iqw"))
    t_s = columns("unix_s")[:, 0]
    rng = np.random.default_rng(67)
    T = se3.transform(R_inertial_camera @ R_camera_body, np.zeros((len(t_s), 3)))
    noise_rad = float(np.deg2rad(noise_deg))
    motion = _estimate(t_s - t_s[0], _noisy(T, noise_rad, rng), noise_rad, t_s[-1:] - t_s[0])
    if motion.axis is None:
        return {"axis": "unobservable"}
    ra, dec = np.deg2rad(POLE_DEG)
    pole = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    period_h = 2.0 * np.pi / motion.rate_rad_s / 3600.0
    return {
        "poses": len(t_s),
        "axis_error_deg": float(np.rad2deg(np.arccos(np.clip(motion.axis @ pole, -1.0, 1.0)))),
        "axis_sigma_deg": float(np.rad2deg(motion.axis_sigma_rad)),
        "period_error_percent": 100.0 * (period_h / PERIOD_H - 1.0),
        "moments_of_inertia": "unobservable"
        if motion.moment_ratios is None
        else motion.moment_ratios.tolist(),
    }


def single_axis(data: Path, start: int, n: int) -> dict[str, Any]:
    """Return the result for a part of the single-axis rotation of SHIRT, every 5 s."""
    with gzip.open(data / "shirt_trajectories" / "roe1.csv.gz", "rt") as file:
        rows = np.array([line.split(",") for line in file.read().splitlines()[1:]], dtype=float)
    T = se3.transform(se3.matrix_from_quaternion_xyzw(rows[:, [2, 3, 4, 1]]), rows[:, 5:])
    t_s, last = INTERVAL_S * np.arange(len(T)), start + n - 1
    rng = np.random.default_rng(1)
    observed, ahead = slice(start, start + n), last + round(HORIZON_S / INTERVAL_S)
    sigma_rad = float(np.deg2rad(SIGMA_DEG))
    motion = _estimate(t_s[observed], _noisy(T[observed], sigma_rad, rng), sigma_rad, t_s[[last, ahead]])
    rotation_errors = se3.log_so3(motion.poses[:, :3, :3] @ np.swapaxes(T[[last, ahead], :3, :3], 1, 2))
    shift = motion.poses[:, :3, 3] - T[[last, ahead], :3, 3]
    return {
        "moments_of_inertia": "unobservable"
        if motion.moment_ratios is None
        else motion.moment_ratios.tolist(),
        "error_deg": np.rad2deg(np.linalg.norm(rotation_errors, axis=1)).tolist(),
        "error_mm": (1e3 * np.linalg.norm(shift, axis=1)).tolist(),
        "centre_m": motion.centre_m.tolist(),
    }


def _noisy(T: FloatArray, sigma_rad: float, rng: np.random.Generator) -> FloatArray:
    R = se3.exp_so3(rng.normal(size=(len(T), 3)) * sigma_rad) @ T[:, :3, :3]
    return np.asarray(se3.transform(R, T[:, :3, 3] + rng.normal(size=(len(T), 3)) * SIGMA_M))


def _estimate(
    t_s: FloatArray, poses: FloatArray, sigma_rad: float, queries_s: FloatArray
) -> BodyMotionEstimationOutputs:
    dfn = Registry.default().make_dfn("body_motion_estimation")
    dfn.configure()
    covariance = np.diag([SIGMA_M**2] * 3 + [float(sigma_rad) ** 2] * 3)
    outputs: BodyMotionEstimationOutputs = dfn.process(
        BodyMotionEstimationInputs(
            times_s=t_s,
            poses=poses,
            covariances=np.repeat(covariance[None], len(t_s), axis=0),
            is_noise_known=True,
            queries_s=queries_s,
            is_fitted=False,
        )
    )
    return outputs


def _spread(values: list[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "largest": float(np.max(values))}
