# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a known body in the scans of ``target_detection`` by target_detection and by other methods.

All methods receive the same scans. The other methods receive the points of the visible surface of the mesh
that target_detection prepares; Open3D's FPFH with RANSAC and KISS-Matcher have no other knowledge of the
mesh. ``icp_starts`` is point-to-plane ICP of Open3D from 60 random rotations at the centroid of the scan; the
result with the smallest mean squared distance from the surface, truncated at 10 cm, counts. The result of KISS-Matcher, if it is installed in an
environment of ``evaluation.peers``, is refined by the same ICP. A pose is correct within 5 degrees and 5 cm.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.types import Pointcloud
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs, ModelPreparationOutputs
from cdff_core.dfns.model_preparation.visible_surface import VisibleSurface
from cdff_dev.compare.registration.rates import interval, rate_text
from evaluation.data_sets.object_views import View
from evaluation.peers.environments import peer_python
from evaluation.scenes.target_scans import SENSORS, Body, Scan, random_scan, tango
from evaluation.shot_localisation_real import fpfh_ransac, kiss_matcher_answer
from evaluation.target_detection import LIMIT_DEG, LIMIT_M, detector

PAGE = "target_detection"
OPTIONS = {"count": 20}
#: Rotations from which ICP starts, its iterations, and limits of its correspondences, metres: first and last.
_STARTS, _ITERATIONS, _LIMITS_M = 60, 30, (0.3, 0.1)
_NAMES = {
    "cdff": "target_detection",
    "icp_starts": "Open3D ICP from 60 rotations",
    "fpfh_ransac": "Open3D FPFH, RANSAC, ICP",
    "kiss_matcher": "KISS-Matcher, ICP",
}

#: T_sensor_model (4, 4) or None, and CPU seconds.
Answer = tuple[FloatArray | None, float]
Method = Callable[[Scan, int], Answer]


def evaluate(data: Path, progress: Callable[[str], None], count: int = 20) -> dict[str, Any]:
    """Return success, errors and CPU time of each method for each sensor."""
    body = tango(data)
    return {
        sensor_name: {
            name: _measured(
                method,
                [random_scan(body, sensor, seed) for seed in range(count)],
                f"{name}, {sensor_name}",
                progress,
            )
            for name, method in methods(body).items()
        }
        for sensor_name, sensor in SENSORS.items()
    }


def methods(body: Body) -> dict[str, Method]:
    """Return the methods by name; without its environment KISS-Matcher is missing."""
    prepare = VisibleSurface()
    prepare.configure()
    model = prepare.process(ModelPreparationInputs(vertices=body.vertices, triangles=body.triangles))
    dfpc = detector(body, "tango")
    found: dict[str, Method] = {
        "cdff": lambda scan, _: _detected(dfpc, scan),
        "icp_starts": lambda scan, seed: icp_from_starts(model, scan.points_m, seed),
        "fpfh_ransac": lambda scan, _: fpfh_ransac(_view(model, scan))[:2],
    }
    if python := peer_python("kiss_matcher"):
        found["kiss_matcher"] = lambda scan, _: _matched(python, model, scan)
    return found


def _view(model: ModelPreparationOutputs, scan: Scan) -> View:
    return View("scan", model.points, scan.points_m, (scan.T_sensor_model,))


def _detected(dfpc: Dfpc, scan: Scan) -> Answer:
    """Return the first detection."""
    value = Pointcloud.from_points(scan.points_m, frame="lidar", stamp_ns=0)
    start_s = time.process_time()
    (output,) = dfpc.step(Sample("cloud", 0, 0, value))
    cpu_s = time.process_time() - start_s
    T = None if output.value is None else output.value.detections[0].pose.transform.matrix
    return T, cpu_s


def _matched(python: str, model: ModelPreparationOutputs, scan: Scan) -> Answer:
    """Return the pose of KISS-Matcher after ICP."""
    T, cpu_s, _ = kiss_matcher_answer(python, _view(model, scan))
    if T is None:
        return None, cpu_s
    start_s = time.process_time()
    T, _ = _icp(model, scan.points_m, T)
    return T, cpu_s + time.process_time() - start_s


def icp_from_starts(model: ModelPreparationOutputs, points_m: FloatArray, seed: int) -> Answer:
    """Return the best result of ICP from random rotations."""
    start_s = time.process_time()
    rotations = Rotation.random(_STARTS, random_state=seed).as_matrix()
    centroid_m = points_m.mean(axis=0)
    starts = [se3.transform(R, centroid_m - R @ model.centre_m) for R in rotations]
    results = [_icp(model, points_m, T) for T in starts]
    best, _ = min(results, key=lambda result: result[1])
    return best, time.process_time() - start_s


def _icp(model: ModelPreparationOutputs, points_m: FloatArray, T: FloatArray) -> tuple[FloatArray, float]:
    """Return the registered pose, and the mean squared distance of the points from the surface, truncated."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(model.points))
    target.normals = o3d.utility.Vector3dVector(model.normals)
    source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    T_model_sensor = se3.inverse(T)
    for limit_m in _LIMITS_M:
        result = registration.registration_icp(
            source,
            target,
            limit_m,
            T_model_sensor,
            registration.TransformationEstimationPointToPlane(),
            registration.ICPConvergenceCriteria(max_iteration=_ITERATIONS),
        )
        T_model_sensor = np.asarray(result.transformation)
    near = float(result.fitness)
    cost = near * float(result.inlier_rmse) ** 2 + (1.0 - near) * _LIMITS_M[-1] ** 2
    return se3.inverse(T_model_sensor), cost


def _measured(
    method: Method, scans: list[Scan], label: str, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return the figures of a method."""
    errors, cpu_s, answered = [], [], 0
    for seed, scan in enumerate(scans):
        progress(f"target_detection_peers: {label}, {seed} of {len(scans)}")
        T, seconds = method(scan, seed)
        cpu_s.append(seconds)
        if T is None:
            continue
        answered += 1
        angle_deg = float(np.degrees(se3.rotation_angle(T[:3, :3].T @ scan.T_sensor_model[:3, :3])))
        distance_m = float(np.linalg.norm(T[:3, 3] - scan.T_sensor_model[:3, 3]))
        if angle_deg <= LIMIT_DEG and distance_m <= LIMIT_M:
            errors.append((angle_deg, distance_m))
    result = {"scans": len(scans), "answered": answered, "correct": len(errors)}
    result |= {"median_cpu_s": _rounded(np.median(cpu_s))}
    if errors:
        angles_deg, distances_m = np.array(errors).T
        result |= {"median_deg": _rounded(np.median(angles_deg))}
        result |= {"median_mm": _rounded(1000.0 * np.median(distances_m))}
    return result


def table(figures: dict[str, Any]) -> str:
    """Return the table of the page."""
    lines = ["| scans | method | correct | wrong | median error | CPU s |", "|---|---|---|---|---|---|"]
    for sensor_name, rows in figures.items():
        for name, row in rows.items():
            error = f"{row['median_deg']}°, {row['median_mm']} mm" if row["correct"] else "–"
            correct = rate_text(interval(row["correct"], row["scans"]))
            lines.append(
                f"| {sensor_name} | {_NAMES[name]} | {correct} | {row['answered'] - row['correct']} | {error} | "
                f"{row['median_cpu_s']} |"
            )
    return "\n".join(lines)


def _rounded(value: Any) -> float:
    return float(f"{float(value):.3g}")
