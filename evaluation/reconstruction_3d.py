# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces from RGB-D images of a kitchen and from simulated lidar scans of a tumbling satellite.

Every second depth image of 7-Scenes is fused; the depths of the others are compared with the surface. The
poses of the scans are the true ones with the noise of a tracker. ``unknown_poses``: other rotations of the
satellite, whose scans are registered with the surface.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Mesh, Pointcloud, TransformWithCovariance
from cdff_core.rigid_body.torque_free import TorqueFreeBody
from cdff_dev.logs.opened import opened
from evaluation.scenes.target_scans import Body, Sensor, scan_at, tango

PARTS = ("rgbd", "lidar", "unknown_poses")
#: Lidar of 64 x 64 points that shows Tango at 10 m, and the noise of the poses: of each axis, m and degrees.
LIDAR = Sensor(64, 12.0, 0.02, (10.0, 10.0))
#: Voxels and views that suit the thin panels of the satellite.
LIDAR_PARAMETERS = {"voxel_m": 0.02, "fusion": {"truncation_voxels": 3.0, "min_views": 5}}
SCANS, INTERVAL_S, RATE_DEG_S = 200, 5.0, 1.5
POSE_NOISES = {"true poses": (0.0, 0.0), "poses with noise of 3 mm and 0.2 deg": (0.003, 0.2)}
#: Lidar, seeds of the rotations, and interval between the scans, s, with unknown poses.
UNKNOWN_LIDAR = Sensor(128, 12.0, 0.02, (10.0, 10.0))
UNKNOWN_SEEDS, UNKNOWN_INTERVAL_S = (11, 12, 13, 14, 15), 2.0
#: Unused depth images that are compared: every n-th.
COMPARED = 5


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the results."""
    figures: dict[str, Any] = {}
    if "rgbd" in parts:
        progress("reconstruction_3d: 7-Scenes")
        figures["rgbd"] = seven_scenes(data)
    if "lidar" in parts:
        figures["lidar"] = {}
        for name, noise in POSE_NOISES.items():
            progress(f"reconstruction_3d: {name}")
            figures["lidar"][name] = tumbling_client(tango(data), *noise)
    if "unknown_poses" in parts:
        progress("reconstruction_3d: unknown poses")
        figures["unknown_poses"] = [unknown_client(tango(data), seed) for seed in UNKNOWN_SEEDS]
    return figures


def unknown_client(body: Body, seed: int) -> dict[str, Any]:
    """Return the errors of poses and surface of a rotating satellite without known poses."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    motion = TorqueFreeBody(
        [0.6, 0.8, 1.0],
        np.deg2rad(RATE_DEG_S) * axis / np.linalg.norm(axis),
        se3.exp_so3(rng.normal(size=3)),
    )
    t_s = UNKNOWN_INTERVAL_S * np.arange(SCANS)
    R = motion.orientations(t_s)
    centre = 0.5 * (body.vertices.min(axis=0) + body.vertices.max(axis=0))
    truth = se3.transform(R, np.array([0.0, 0.0, 10.0]) - R @ centre)
    dfpc = _dfpc({"range_sigma_m": UNKNOWN_LIDAR.sigma_m, "solve_poses": True, **LIDAR_PARAMETERS})
    T_model_body, cpu_s, errors, squared = np.eye(4), 0.0, [], []
    for number, T_sensor_body in enumerate(truth):
        stamp_ns = 1000 * round(1e6 * t_s[number])
        points = scan_at(body, UNKNOWN_LIDAR, T_sensor_body, rng)
        cloud = Pointcloud.from_points(points, frame="servicer/lidar", stamp_ns=stamp_ns)
        started = time.process_time()
        outputs = list(dfpc.step(Sample("cloud", stamp_ns, number, cloud, frame="servicer/lidar")))
        cpu_s += time.process_time() - started
        if not outputs:
            continue
        pose = outputs[0].value.transform
        if not number:
            T_model_body = pose.matrix @ T_sensor_body
            continue
        error = pose_error(T_model_body @ se3.inverse(T_sensor_body), pose.matrix)
        errors.append(float(np.degrees(np.linalg.norm(error[3:]))))
        squared.append(float(error @ np.linalg.solve(pose.covariance, error)))
    list(dfpc.finish())
    mesh: Mesh = dfpc.store.get("mesh")
    vertices = se3.transform_points(se3.inverse(T_model_body), mesh.data.vertices.astype(np.float64))
    distances = _distances(body, vertices)
    return {
        "seed": seed,
        "registered_percent": 100.0 * (1 + len(errors)) / SCANS,
        "rotation_deg": {"median": float(np.median(errors)), "largest": max(errors)},
        "mean_nees": float(np.mean(squared)),
        "distance_mm": {
            "rms": 1e3 * float(np.sqrt(np.mean(distances**2))),
            "median": 1e3 * float(np.median(distances)),
        },
        "cpu_s_per_scan": cpu_s / SCANS,
    }


def seven_scenes(data: Path) -> dict[str, Any]:
    """Return the residuals of the depth images that are not part of the surface."""
    dfpc = _dfpc({})
    with opened(data / "seven_scenes_redkitchen") as log:
        depth, truth = "/seven_scenes/depth.depth", "/seven_scenes/truth.pose"
        captures = [item.to_sample("depth", "seven_scenes") for item in log.samples([depth])]
        poses = {s.stamp_ns: s for s in (i.to_sample("poses", "seven_scenes") for i in log.samples([truth]))}
    started = time.process_time()
    for sample in captures[::2]:
        list(dfpc.step(sample))
        list(dfpc.step(poses[sample.stamp_ns]))
    list(dfpc.finish())
    cpu_s = time.process_time() - started
    mesh: Mesh = dfpc.store.get("mesh")
    surface = Body(mesh.data.vertices, mesh.data.triangles.astype(np.int64))
    residuals, covered = [], []
    for sample in captures[1::2][::COMPARED]:
        image, T = sample.value, poses[sample.stamp_ns].value.transform.matrix
        u = np.arange(image.width) * image.scale_x + image.center_x
        v = np.arange(image.height) * image.scale_y + image.center_y
        measured = image.data.reshape(image.height, image.width)
        rays = np.stack(np.broadcast_arrays(u, v[:, None], 1.0), axis=2).reshape(-1, 3)
        expected = _cast(surface, T, rays).reshape(measured.shape)
        is_compared = (measured > 0.0) & np.isfinite(expected)
        residuals.append(np.abs(measured - expected)[is_compared])
        covered.append(is_compared.sum() / np.count_nonzero(measured))
    every = np.concatenate(residuals)
    return {
        "fused_images": len(captures[::2]),
        "compared_images": len(residuals),
        "residual_mm": {"median": 1e3 * float(np.median(every)), "p90": 1e3 * float(np.quantile(every, 0.9))},
        "covered_percent": 100.0 * float(np.mean(covered)),
        "vertices": len(mesh.data.vertices),
        "cpu_s_per_image": cpu_s / len(captures[::2]),
    }


def tumbling_client(body: Body, sigma_m: float, sigma_deg: float) -> dict[str, Any]:
    """Return the distances between the surface of a tumbling satellite and its mesh."""
    rng = np.random.default_rng(21)
    rate = np.deg2rad(RATE_DEG_S) * np.array([0.4, 0.5, 0.77])
    t_s = INTERVAL_S * np.arange(SCANS)
    R = TorqueFreeBody([0.6, 0.8, 1.0], rate).orientations(t_s)
    centre = 0.5 * (body.vertices.min(axis=0) + body.vertices.max(axis=0))
    truth = se3.transform(R, np.array([0.0, 0.0, 10.0]) - R @ centre)
    noisy_rotations = se3.exp_so3(rng.normal(size=(SCANS, 3)) * np.deg2rad(sigma_deg)) @ R
    poses = se3.transform(
        noisy_rotations,
        truth[:, :3, 3] + (R - noisy_rotations) @ centre + sigma_m * rng.normal(size=(SCANS, 3)),
    )
    dfpc = _dfpc({"range_sigma_m": LIDAR.sigma_m, **LIDAR_PARAMETERS})
    cpu_s = 0.0
    for number, T in enumerate(poses):
        stamp_ns = 1000 * round(1e6 * t_s[number])
        points = scan_at(body, LIDAR, truth[number], rng)
        cloud = Pointcloud.from_points(points, frame="servicer/lidar", stamp_ns=stamp_ns)
        pose = TransformWithCovariance.from_transform(
            UncertainTransform.exact(T), parent="servicer/lidar", child="client/body", stamp_ns=stamp_ns
        )
        started = time.process_time()
        list(dfpc.step(Sample("cloud", stamp_ns, number, cloud, frame="servicer/lidar")))
        list(dfpc.step(Sample("poses", stamp_ns, number, pose)))
        cpu_s += time.process_time() - started
    list(dfpc.finish())
    mesh: Mesh = dfpc.store.get("mesh")
    distances = _distances(body, mesh.data.vertices)
    surface = Body(mesh.data.vertices, mesh.data.triangles.astype(np.int64))
    back = _distances(surface, _seen_points(body, truth, rng))
    return {
        "scans": SCANS,
        "points_per_scan": len(points),
        "distance_mm": {
            "rms": 1e3 * float(np.sqrt(np.mean(distances**2))),
            "median": 1e3 * float(np.median(distances)),
            "p95": 1e3 * float(np.quantile(distances, 0.95)),
        },
        "complete_within_30_mm_percent": 100.0 * float(np.mean(back < 0.03)),
        "cpu_s_per_scan": cpu_s / SCANS,
    }


def _seen_points(body: Body, poses: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return exact points of the body that the sensor sees, in the frame of the body."""
    exact = Sensor(LIDAR.pixels, LIDAR.field_deg, 0.0, LIDAR.ranges_m)
    scans = []
    for T in poses[::10]:
        inverse = se3.inverse(T)
        scans.append(scan_at(body, exact, T, rng) @ inverse[:3, :3].T + inverse[:3, 3])
    return np.concatenate(scans)


def _distances(body: Body, points: FloatArray) -> FloatArray:
    import open3d as o3d

    query = o3d.core.Tensor(points.astype(np.float32))
    return np.asarray(body.scene.compute_distance(query, nthreads=1).numpy(), np.float64)


def _cast(body: Body, T_body_camera: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the depth (n,) of the body along rays (n, 3) with z = 1 in the camera, metres; inf if missed."""
    import open3d as o3d

    starts = np.broadcast_to(T_body_camera[:3, 3], rays.shape)
    query = np.hstack([starts, rays @ T_body_camera[:3, :3].T]).astype(np.float32)
    return np.asarray(body.scene.cast_rays(o3d.core.Tensor(query))["t_hit"].numpy(), np.float64)


def _dfpc(parameters: dict[str, Any]) -> Dfpc:
    dfpc = Registry.default().make_dfpc("reconstruction_3d")
    dfpc.configure({"publish_every": 100_000, **parameters})
    return dfpc


def table(figures: dict[str, Any]) -> str:
    """Return the tables of the page."""
    lines = []
    if "rgbd" in figures:
        row = figures["rgbd"]
        lines += [
            "| 7-Scenes | value |",
            "|---|---|",
            f"| depth images fused, compared | {row['fused_images']}, {row['compared_images']} |",
            f"| residual of unused depths, median | {row['residual_mm']['median']:.1f} mm |",
            f"| 90 % below | {row['residual_mm']['p90']:.1f} mm |",
            f"| depths with a surface | {row['covered_percent']:.1f} % |",
            f"| CPU per image | {row['cpu_s_per_image']:.2f} s |",
            "",
        ]
    if "lidar" in figures:
        lines += [
            "| satellite at 10 m | RMS | median | 95 % below | complete within 30 mm | CPU per scan |",
            "|---|---|---|---|---|---|",
        ]
        lines += [
            f"| {name} | {row['distance_mm']['rms']:.1f} mm | {row['distance_mm']['median']:.1f} mm | "
            f"{row['distance_mm']['p95']:.1f} mm | {row['complete_within_30_mm_percent']:.1f} % | "
            f"{row['cpu_s_per_scan']:.3f} s |"
            for name, row in figures["lidar"].items()
        ]
    if "unknown_poses" in figures:
        lines += [
            "",
            "| unknown poses, seed | scans registered | rotation error, median | largest | NEES (6) "
            "| surface RMS | median | CPU per scan |",
            "|---|---|---|---|---|---|---|---|",
        ]
        lines += [
            f"| {row['seed']} | {row['registered_percent']:.0f} % | {row['rotation_deg']['median']:.2f}° | "
            f"{row['rotation_deg']['largest']:.2f}° | {row['mean_nees']:.2f} | "
            f"{row['distance_mm']['rms']:.1f} mm | {row['distance_mm']['median']:.1f} mm | "
            f"{row['cpu_s_per_scan']:.3f} s |"
            for row in figures["unknown_poses"]
        ]
    return "\n".join(lines)
