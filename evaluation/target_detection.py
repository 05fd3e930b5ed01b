# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detect known bodies in simulated lidar scans: success, errors, covariance, CPU time, and refusals.

Scans are made by Open3D's ray casting, independent of the renderer of the detection. A detection is correct
within 5 degrees and 5 cm (4 % of the diameter of Tango); for symmetric bodies the closest of the equivalent
poses counts. The noise of the sensor is not given to the detection.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from cdff_dev.compare.registration.rates import interval, rate_text
from evaluation.peers.body_poses import fpfh_ransac, icp_of_rotations, kiss_matcher_pose
from evaluation.peers.environments import peer_python
from evaluation.scenes.target_scans import (
    SENSORS,
    Body,
    Sensor,
    box,
    model_sample,
    random_scan,
    read_body,
    surface_points,
    tango,
    with_faults,
)

PARTS = ("views", "faults", "other_bodies", "other_models", "peers")
OPTIONS = {"count": 200}
LIMIT_DEG, LIMIT_M = 5.0, 0.05
#: Fraction of the views with which the parts after the first are evaluated.
_FEWER = 0.2


def evaluate(
    data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS, count: int = 200
) -> dict[str, Any]:
    """Return the results of each part."""
    client, fewer = tango(data), max(1, int(_FEWER * count))
    detection = detector(client, "tango")
    figures: dict[str, Any] = {}
    if "views" in parts:
        figures["views"] = {
            name: measured(detection, client, sensor, count, f"views, {name}", progress)
            for name, sensor in SENSORS.items()
        }
    if "faults" in parts:
        figures["faults"] = {
            name: measured(detection, client, with_faults(sensor), fewer, f"faults, {name}", progress)
            for name, sensor in SENSORS.items()
        }
    if "other_bodies" in parts:
        figures["other_bodies"] = {
            f"{body_name}, {name}": refused(detection, body, sensor, fewer, progress)
            for body_name, body in other_bodies(data).items()
            for name, sensor in SENSORS.items()
        }
    if "other_models" in parts:
        figures["other_models"] = {}
        for body_name, body in list(other_bodies(data).items())[:3]:
            body_detector = detector(body, body_name)
            figures["other_models"] |= {
                f"{body_name}, {name}": measured(
                    body_detector, body, sensor, fewer, f"{body_name}, {name}", progress
                )
                for name, sensor in SENSORS.items()
            }
    if "peers" in parts:
        figures["peers"] = {
            name: peers(detection, client, sensor, fewer, f"peers, {name}", progress)
            for name, sensor in SENSORS.items()
        }
    return figures


def other_bodies(data: Path) -> dict[str, Body]:
    """Return other bodies with the size of Tango."""
    models = data / "space_models"
    return {
        "hst": read_body(models / "HST.obj", 1.4),
        "aura": read_body(models / "Aura_SolarArray.obj", 1.4),
        "67p": read_body(data / "rosetta_67p" / "67p_16k.ply", 1.4),
        "kepler": read_body(models / "Kepler.obj", 1.4),
        "box": box((1.1, 1.0, 0.34)),
    }


def detector(body: Body, name: str) -> Dfpc:
    """Return the compound with a prepared model."""
    dfpc = Registry.default().make_dfpc("target_detection")
    dfpc.configure()
    list(dfpc.step(model_sample(body, name)))
    return dfpc


def measured(
    dfpc: Dfpc, body: Body, sensor: Sensor, count: int, label: str, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return success, errors, NEES and CPU time over random views of the body."""
    errors, nees, cpu_s, points = [], [], [], []
    wrong = wrong_and_ok = degraded = 0
    for seed in range(count):
        progress(f"target_detection: {label}, {seed} of {count}")
        scan = random_scan(body, sensor, seed)
        output, seconds = _detected(dfpc, scan.points_m)
        cpu_s.append(seconds)
        points.append(len(scan.points_m))
        if output.value is None:
            continue
        degraded += output.quality.status.name == "DEGRADED"
        detection = output.value.detections[0]
        pose = detection.pose.transform
        candidates = np.stack([pose.matrix, *detection.symmetric_matrices])
        differences = np.swapaxes(candidates[:, :3, :3], 1, 2) @ scan.T_sensor_model[:3, :3]
        angles = np.degrees(se3.rotation_angle(differences))
        best = int(np.argmin(angles))
        distance_m = float(np.linalg.norm(candidates[best, :3, 3] - scan.T_sensor_model[:3, 3]))
        if angles[best] > LIMIT_DEG or distance_m > LIMIT_M:
            wrong += 1
            wrong_and_ok += output.quality.status.name == "OK"
            continue
        errors.append((float(angles[best]), distance_m))
        if best == 0:
            error = pose_error(scan.T_sensor_model, pose.matrix)
            nees.append(float(error @ np.linalg.solve(pose.covariance, error)))
    angles_deg, distances_m = np.array(errors).reshape(-1, 2).T
    return {
        "views": count,
        "median_points": int(np.median(points)),
        "correct": len(errors),
        "wrong": wrong,
        "wrong_and_ok": wrong_and_ok,
        "refused": count - len(errors) - wrong,
        "degraded": degraded,
        "median_deg": _rounded(np.median(angles_deg)) if errors else None,
        "median_mm": _rounded(1000.0 * np.median(distances_m)) if errors else None,
        "p95_deg": _rounded(np.quantile(angles_deg, 0.95)) if errors else None,
        "p95_mm": _rounded(1000.0 * np.quantile(distances_m, 0.95)) if errors else None,
        "mean_nees": _rounded(np.mean(nees)) if nees else None,
        "median_nees": _rounded(np.median(nees)) if nees else None,
        "median_cpu_s": _rounded(np.median(cpu_s)),
        "p99_cpu_s": _rounded(np.quantile(cpu_s, 0.99)),
    }


def refused(
    dfpc: Dfpc, body: Body, sensor: Sensor, count: int, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return how many scans of another body are refused."""
    answers = []
    for seed in range(count):
        progress(f"target_detection: other body, {seed} of {count}")
        output, _ = _detected(dfpc, random_scan(body, sensor, seed).points_m)
        answers.append(output.value is None)
    return {"views": count, "refused": int(sum(answers))}


def peers(
    dfpc: Dfpc, body: Body, sensor: Sensor, count: int, label: str, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return success and CPU time of the detection and of other programs in the same scans.

    The other programs get points that are evenly spread over the surface of the body.
    """
    model_m = surface_points(body)
    python = peer_python("kiss_matcher")
    methods: dict[str, Callable[[FloatArray], tuple[FloatArray | None, float]]] = {
        "cdff": lambda points_m: _first_pose(*_detected(dfpc, points_m)),
        "icp_60_rotations": lambda points_m: icp_of_rotations(model_m, points_m),
        "fpfh_ransac": lambda points_m: fpfh_ransac(model_m, points_m),
    }
    if python:
        methods["kiss_matcher"] = lambda points_m: kiss_matcher_pose(python, model_m, points_m)
    rows: dict[str, list[tuple[bool, bool, float]]] = {name: [] for name in methods}
    for seed in range(count):
        progress(f"target_detection: {label}, {seed} of {count}")
        scan = random_scan(body, sensor, seed)
        for name, method in methods.items():
            T, cpu_s = method(scan.points_m)
            rows[name].append((T is not None, T is not None and is_correct(T, scan.T_sensor_model), cpu_s))
    return {
        name: {
            "views": count,
            "correct": sum(correct for _, correct, _ in row),
            "wrong": sum(answered and not correct for answered, correct, _ in row),
            "median_cpu_s": _rounded(np.median([cpu_s for *_, cpu_s in row])),
        }
        for name, row in rows.items()
    }


def is_correct(T: FloatArray, T_true: FloatArray) -> bool:
    """Return whether a pose (4, 4) is within the limits."""
    angle_deg = float(np.degrees(se3.rotation_angle(T[:3, :3].T @ T_true[:3, :3])))
    return angle_deg <= LIMIT_DEG and float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])) <= LIMIT_M


def table(figures: dict[str, Any]) -> str:
    """Return the tables of the page."""
    lines = [
        "| scans | points | correct | wrong (of them OK) | refused | median error | 95 % | "
        "median NEES (5.3 expected) | CPU s, median, 99 % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for part in ("views", "faults", "other_models"):
        for name, row in figures.get(part, {}).items():
            label = {"views": "tango, ", "faults": "tango with faults, "}.get(part, "") + name
            correct = rate_text(interval(row["correct"], row["views"]))
            lines.append(
                f"| {label} | {row['median_points']} | {correct} | {row['wrong']} ({row['wrong_and_ok']}) | "
                f"{row['refused']} | {row['median_deg']}°, {row['median_mm']} mm | "
                f"{row['p95_deg']}°, {row['p95_mm']} mm | "
                f"{row['median_nees']} | {row['median_cpu_s']}, {row['p99_cpu_s']} |"
            )
    lines += ["", "| scans of another body, model of Tango | refused |", "|---|---|"]
    for name, row in figures.get("other_bodies", {}).items():
        lines.append(f"| {name} | {rate_text(interval(row['refused'], row['views']))} |")
    if "peers" in figures:
        lines += ["", "| scans | program | correct | wrong | CPU s, median |", "|---|---|---|---|---|"]
    for name, programs in figures.get("peers", {}).items():
        for program, row in programs.items():
            correct = rate_text(interval(row["correct"], row["views"]))
            lines.append(f"| {name} | {program} | {correct} | {row['wrong']} | {row['median_cpu_s']} |")
    return "\n".join(lines)


def _first_pose(output: Output, cpu_s: float) -> tuple[FloatArray | None, float]:
    detections = [] if output.value is None else output.value.detections
    return (detections[0].pose.transform.matrix if detections else None), cpu_s


def _detected(dfpc: Dfpc, points_m: np.ndarray) -> tuple[Output, float]:
    """Return the output of a scan and the CPU seconds."""
    value = Pointcloud.from_points(points_m, frame="lidar", stamp_ns=0)
    start_s = time.process_time()
    (output,) = dfpc.step(Sample("cloud", 0, 0, value))
    return output, time.process_time() - start_s


def _rounded(value: float) -> float:
    return float(f"{float(value):.3g}")
