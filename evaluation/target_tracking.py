# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Track Tango in simulated lidar scans along SHIRT roe1 and along a tumble about two axes.

``lidar``: scans of 64 × 64 rays are the input of lidar_target_tracking. ``poses``: the same scans are
registered with the mesh (point-to-plane, start at the predicted pose, no prediction in the result), and the
poses are the input of target_tracking. ``rotation_during_scan``: a scan lasts 1 s at 10 degrees per second,
one line of rays at a time. ``disturbed``: outliers, occlusion, and a single plane in view. All with default
parameters.
"""

from __future__ import annotations

import gzip
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs
from cdff_core.dfns.model_registration.interface import ModelRegistrationInputs
from cdff_core.object_models.scan_detection import surface_ports
from cdff_core.rigid_body.torque_free import TorqueFreeBody
from evaluation.scenes.target_scans import Body, Sensor, line_scan_at, model_sample, scan_at, tango

PARTS = ("lidar", "poses", "rotation_during_scan", "disturbed")
INTERVAL_S = 5.0
SENSOR = Sensor(64, 14.0, 0.02, (7.0, 8.0))
#: Frames of a revolution of roe1, and of each run.
REVOLUTION, FRAMES = 77, 160
MOMENTS, RATE_DEG_S, CENTRE_M = (3.0, 2.5, 1.5), (0.5, 0.4, 0.4), (0.05, -0.04, 0.15)
SCAN_S, FAST_DEG_S, FAST_SCANS, SETTLED = 1.0, 10.0, 40, 10
Pose = Callable[[float], FloatArray]


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the results of each part."""
    body, figures = tango(data), {}
    motions = {"roe1": roe1(data), "two-axis tumble": tumble()}
    every = {
        "every frame": list(range(FRAMES)),
        "12 frames lost": [*range(100), *range(112, FRAMES)],
        "every 4th frame": list(range(0, 3 * FRAMES, 4)),
    }
    for part, track in (("lidar", _lidar_errors), ("poses", _pose_errors)):
        if part in parts:
            figures[part] = {}
            for name, poses in motions.items():
                for label, frames in every.items():
                    progress(f"target_tracking: {part}, {name}, {label}")
                    figures[part][f"{name}, {label}"] = _summary(track(body, poses, frames), frames)
    if "rotation_during_scan" in parts:
        progress("target_tracking: rotation during a scan")
        figures["rotation_during_scan"] = rotation_during_scan(body)
    if "disturbed" in parts:
        figures["disturbed"] = {}
        for name, change in DISTURBANCES.items():
            progress(f"target_tracking: {name}")
            frames = every["every frame"]
            errors = _lidar_errors(body, motions["roe1"], frames, change)
            figures["disturbed"][name] = _summary(errors, frames)
    return figures


def roe1(data: Path) -> FloatArray:
    """Return T_sensor_body (n, 4, 4) of SHIRT roe1, every 5 s."""
    with gzip.open(data / "shirt_trajectories" / "roe1.csv.gz", "rt") as file:
        rows = np.array([line.split(",") for line in file.read().splitlines()[1:]], dtype=float)
    return se3.transform(se3.matrix_from_quaternion_xyzw(rows[:, [2, 3, 4, 1]]), rows[:, 5:])


def tumble(frames: int = 3 * FRAMES) -> FloatArray:
    """Return T_sensor_body (n, 4, 4) of a free rotation about two axes."""
    t_s = INTERVAL_S * np.arange(frames)
    body = TorqueFreeBody(MOMENTS, np.radians(RATE_DEG_S), se3.exp_so3([0.4, -1.0, 0.3]))
    R = body.orientations(t_s)
    return se3.transform(
        R, np.array([-0.1, -0.2, 7.5]) + np.outer(t_s, [1e-4, 0, -2e-4]) - R @ np.array(CENTRE_M)
    )


def _outliers(points_m: FloatArray, frame: int, rng: np.random.Generator) -> FloatArray:
    ranges = np.linalg.norm(points_m, axis=1, keepdims=True)
    wrong = rng.random((len(points_m), 1)) < 0.3
    return np.asarray(points_m * np.where(wrong, 1.0 + rng.uniform(-1.0, 1.0, wrong.shape) / ranges, 1.0))


def _half(points_m: FloatArray, frame: int, rng: np.random.Generator) -> FloatArray:
    return points_m[points_m[:, 0] > np.median(points_m[:, 0])]


def _plane(points_m: FloatArray, frame: int, rng: np.random.Generator) -> FloatArray:
    """Return the points of the largest plane if the frame is one of 12 of 24 after the first revolution."""
    import open3d as o3d

    if frame < REVOLUTION or frame % 24 < 12:
        return points_m
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    o3d.utility.random.seed(frame)
    _, rows = cloud.segment_plane(distance_threshold=0.04, ransac_n=3, num_iterations=300)
    return points_m[rows]


DISTURBANCES = {"30 % outliers": _outliers, "half occluded": _half, "one plane in 12 of 24 frames": _plane}


def rotation_during_scan(body: Body) -> dict[str, Any]:
    """Return median errors with times of the points, without them, and for a body measured at one time."""
    rate = np.radians(FAST_DEG_S) * np.array([0.8, 0.5, 0.33]) / np.linalg.norm([0.8, 0.5, 0.33])
    R = se3.exp_so3([0.4, -1.0, 0.3])

    def pose(t_s: float) -> FloatArray:
        R_now = R @ se3.exp_so3(t_s * rate)
        return se3.transform(R_now, [0.0, 0.0, 7.5] - R_now @ np.array(CENTRE_M))

    results = {}
    for label, duration_s, has_times in (
        ("with times", SCAN_S, True),
        ("without times", SCAN_S, False),
        ("no motion during the scan", 0.0, True),
    ):
        dfpc, errors = _tracker(body), []
        for k in range(FAST_SCANS):
            end_s = 2.0 * k + SCAN_S
            points_m, times_s = line_scan_at(body, SENSOR, pose, end_s, duration_s, np.random.default_rng(k))
            end_ns = round(1e9 * end_s)
            offsets_us = np.rint(1e6 * ((times_s if has_times else 0.0 * times_s) + SCAN_S)).astype(np.uint32)
            value = LidarScan.from_arrays(
                points_m, offsets_us, frame="lidar", t0_ns=end_ns - round(1e9 * SCAN_S), t1_ns=end_ns
            )
            output = next(iter(dfpc.step(Sample("scan", end_ns, k, value))))
            if k >= SETTLED:
                error = pose_error(pose(end_s), output.value.transform.matrix)
                errors.append([np.degrees(np.linalg.norm(error[3:])), 1e3 * np.linalg.norm(error[:3])])
        results[label] = dict(
            zip(("median_deg", "median_mm"), _rounded(np.median(errors, axis=0)), strict=True)
        )
    removed = 1.0 - results["with times"]["median_deg"] / results["without times"]["median_deg"]
    return results | {"removed_percent": round(100.0 * removed, 1)}


def _tracker(body: Body) -> Dfpc:
    dfpc = Registry.default().make_dfpc("lidar_target_tracking")
    dfpc.configure()
    list(dfpc.step(model_sample(body, "tango")))
    return dfpc


def _lidar_errors(
    body: Body,
    poses: FloatArray,
    frames: list[int],
    change: Callable[[FloatArray, int, np.random.Generator], FloatArray] | None = None,
) -> list[dict[str, float]]:
    """Return the errors of lidar_target_tracking for each frame."""
    dfpc, rows = _tracker(body), []
    for k, frame in enumerate(frames):
        rng = np.random.default_rng(frame)
        points_m = scan_at(body, SENSOR, poses[frame], rng)
        if change is not None and k:
            points_m = change(points_m, frame, rng)
        stamp_ns = round(1e9 * INTERVAL_S * frame)
        value = Pointcloud.from_points(points_m, frame="lidar", stamp_ns=stamp_ns)
        rows.append(_errors(dfpc, Sample("cloud", stamp_ns, k, value), poses, frame))
    return rows


def _pose_errors(body: Body, poses: FloatArray, frames: list[int]) -> list[dict[str, float]]:
    """Return the errors of target_tracking for poses measured by registration."""
    registry = Registry.default()
    dfpc, prepare, register = (
        registry.make_dfpc("target_tracking"),
        registry.make_dfn("model_preparation"),
        registry.make_dfn("model_registration"),
    )
    for part in (dfpc, prepare, register):
        part.configure()
    model = prepare.process(ModelPreparationInputs(vertices=body.vertices, triangles=body.triangles))
    rows: list[dict[str, float]] = []
    start, step = poses[frames[0]], np.eye(4)
    for k, frame in enumerate(frames):
        points_m = scan_at(body, SENSOR, poses[frame], np.random.default_rng(frame))
        try:
            outputs = register.process(
                ModelRegistrationInputs(
                    scan=points_m,
                    pose=start @ step,
                    drawn_vertices=model.drawn_vertices,
                    drawn_triangles=model.drawn_triangles,
                    centre_m=model.centre_m,
                    sigma_m=SENSOR.sigma_m,
                    **surface_ports(model),
                )
            )
        except RefusedError:
            continue
        stamp_ns = round(1e9 * INTERVAL_S * frame)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(outputs.pose, outputs.covariance),
            parent="lidar",
            child="tango/body",
            stamp_ns=stamp_ns,
        )
        row = _errors(dfpc, Sample("measurement", stamp_ns, k, value), poses, frame)
        error = pose_error(poses[frame], outputs.pose)
        row["measured_deg"] = float(np.degrees(np.linalg.norm(error[3:])))
        row["measured_mm"] = float(1e3 * np.linalg.norm(error[:3]))
        rows.append(row)
        # The start of the next registration: by the tracked rate.
        if k + 1 < len(frames):
            step = _continued(dfpc, outputs.pose, (frames[k + 1] - frame) * INTERVAL_S)
        start = outputs.pose
    return rows


def _continued(dfpc: Dfpc, T: FloatArray, duration_s: float) -> FloatArray:
    """Return the rotation (4, 4) of the body about its origin until the next frame, by the tracked rate."""
    velocities = dfpc.store.get("last_track").velocities[0]
    rate = T[:3, :3].T @ velocities[3:]
    return se3.transform(se3.exp_so3(duration_s * rate), duration_s * T[:3, :3].T @ velocities[:3])


def _errors(dfpc: Dfpc, sample: Sample, poses: FloatArray, frame: int) -> dict[str, float]:
    start_s = time.process_time()
    pose, track = dfpc.step(sample)
    cpu_s = time.process_time() - start_s
    row = {"frame": float(frame), "cpu_s": cpu_s, "is_coasting": float("coasting" in pose.quality.reasons)}
    row["is_named"] = float(any(reason.startswith("degenerate:") for reason in pose.quality.reasons))
    if pose.value is None or track.value is None:
        return row | {"is_failed": 1.0}
    estimate = pose.value.transform
    error = pose_error(poses[frame], estimate.matrix)
    rotation_vector = (
        se3.log_so3(poses[frame + 1, :3, :3] @ poses[frame - 1, :3, :3].T) if frame else np.zeros(3)
    )
    rate = rotation_vector / (2.0 * INTERVAL_S)
    rate_error = np.linalg.norm(track.value.velocities[0, 3:] - rate) / max(float(np.linalg.norm(rate)), 1e-9)
    return row | {
        "is_failed": 0.0,
        "track": float(track.value.metadata.track_id),
        "deg": float(np.degrees(np.linalg.norm(error[3:]))),
        "mm": float(1e3 * np.linalg.norm(error[:3])),
        "nees": float(error @ np.linalg.solve(estimate.covariance, error)),
        "rate_percent": float(100.0 * rate_error),
    }


def _summary(rows: list[dict[str, float]], frames: list[int]) -> dict[str, Any]:
    """Return medians after the first revolution, and losses."""
    later = [row for row in rows if row["frame"] >= REVOLUTION and not row["is_failed"]]
    columns = {key: np.array([row[key] for row in later]) for key in ("deg", "mm", "nees", "rate_percent")}
    cpu_s = np.array([row["cpu_s"] for row in rows[1:]])
    result: dict[str, Any] = {
        "frames": len(frames),
        "median_deg": _rounded(np.median(columns["deg"])),
        "median_mm": _rounded(np.median(columns["mm"])),
        "largest_deg": _rounded(columns["deg"].max()),
        "largest_mm": _rounded(columns["mm"].max()),
        "median_rate_percent": _rounded(np.median(columns["rate_percent"])),
        "mean_nees": _rounded(np.mean(columns["nees"])),
        "coasting": int(sum(row["is_coasting"] for row in rows)),
        "named_degenerate": int(sum(row["is_named"] for row in rows)),
        "failed": int(sum(row["is_failed"] for row in rows)),
        "tracks": int(max(row.get("track", 0.0) for row in rows)),
        "median_cpu_ms": _rounded(1e3 * np.median(cpu_s)),
    }
    if "measured_deg" in rows[-1]:
        result["measured_deg"] = _rounded(np.median([row["measured_deg"] for row in rows]))
        result["measured_mm"] = _rounded(np.median([row["measured_mm"] for row in rows]))
    return result


def table(figures: dict[str, Any]) -> str:
    """Return the tables of the page."""
    lines = [
        "| input, motion | median | largest | rate error | mean NEES (6 expected) | coasting, failed, tracks "
        "| CPU ms |",
        "|---|---|---|---|---|---|---|",
    ]
    for part in ("lidar", "poses", "disturbed"):
        for name, row in figures.get(part, {}).items():
            measured = (
                f" (measured {row['measured_deg']}°, {row['measured_mm']} mm)" if part == "poses" else ""
            )
            named = f", {row['named_degenerate']} frames with named directions" if part == "disturbed" else ""
            lines.append(
                f"| {part}: {name}{named} | {row['median_deg']}°, {row['median_mm']} mm{measured} | "
                f"{row['largest_deg']}°, {row['largest_mm']} mm | {row['median_rate_percent']} % | "
                f"{row['mean_nees']} | {row['coasting']}, {row['failed']}, {row['tracks']} | "
                f"{row['median_cpu_ms']} |"
            )
    if "rotation_during_scan" in figures:
        rows = figures["rotation_during_scan"]
        lines += ["", "| scan of 1 s, 10 degrees per second | median error |", "|---|---|"]
        lines += [
            f"| {name} | {row['median_deg']}°, {row['median_mm']} mm |"
            for name, row in rows.items()
            if isinstance(row, dict)
        ]
        lines += ["", f"The times of the points remove {rows['removed_percent']} % of the rotation error."]
    return "\n".join(lines)


def _rounded(value: Any) -> Any:
    return [_rounded(v) for v in value] if np.ndim(value) else float(f"{float(value):.3g}")
