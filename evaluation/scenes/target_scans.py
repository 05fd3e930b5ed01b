# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar scans of bodies by Open3D's ray casting, for the evaluation of detection and tracking."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.formats.meshes import read_mesh
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import Mesh


@dataclass(frozen=True)
class Body:
    """A body in its own frame, metres; ``scene`` casts rays at it."""

    vertices: FloatArray
    triangles: IntArray

    @cached_property
    def scene(self) -> Any:
        """Return Open3D's scene of the body."""
        import open3d as o3d

        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(
            o3d.core.Tensor(self.vertices.astype(np.float32)),
            o3d.core.Tensor(self.triangles.astype(np.uint32)),
        )
        return scene


@dataclass(frozen=True)
class Sensor:
    """Square image of a lidar: pixels of a side, field of view, noise along the rays, and ranges to the body.

    ``mixed`` is the fraction of the points next to a step of the range that lie between both surfaces, and
    ``outliers`` that of points with an arbitrary range near the body.
    """

    pixels: int
    field_deg: float
    sigma_m: float
    ranges_m: tuple[float, float]
    mixed: float = 0.0
    outliers: float = 0.0


#: Sensors by the typical number of points of a scan of Tango.
SENSORS = {
    "1900 points": Sensor(128, 19.0, 0.01, (5.0, 7.0)),
    "260 points": Sensor(64, 8.4, 0.03, (15.0, 25.0)),
    "60 points": Sensor(32, 4.2, 0.05, (30.0, 50.0)),
}


@dataclass(frozen=True)
class Scan:
    """Points (n, 3) of a scan, metres, and the true T_sensor_model (4, 4)."""

    points_m: FloatArray
    T_sensor_model: FloatArray


def read_body(path: Path, diameter_m: float | None = None) -> Body:
    """Return the body of a mesh file, scaled to a diameter (of its box) if one is given."""
    mesh = read_mesh(path)
    size = float(np.linalg.norm(np.ptp(mesh.vertices[np.unique(mesh.triangles)], axis=0)))
    scale = 1.0 if diameter_m is None else diameter_m / size
    return Body(scale * mesh.vertices, mesh.triangles)


def tango(data: Path) -> Body:
    """Return the satellite Tango."""
    return read_body(data / "speedplus_lightbox" / "tango.ply")


def box(size_m: tuple[float, float, float]) -> Body:
    """Return a box."""
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh.create_box(*size_m)
    return Body(np.asarray(mesh.vertices), np.asarray(mesh.triangles, np.int64))


def random_pose(rng: np.random.Generator, sensor: Sensor) -> FloatArray:
    """Return T_sensor_model with any rotation; the body is inside the image."""
    q = rng.normal(size=4)
    R = se3.matrix_from_quaternion_xyzw(q / np.linalg.norm(q))
    range_m = rng.uniform(*sensor.ranges_m)
    offset = 0.1 * range_m * np.tan(np.radians(0.5 * sensor.field_deg))
    return se3.transform(R, [*rng.uniform(-offset, offset, 2), range_m])


def scan_at(body: Body, sensor: Sensor, T_sensor_model: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the points (n, 3) of a scan."""
    import open3d as o3d

    n = sensor.pixels
    tangent = np.tan(np.radians(0.5 * sensor.field_deg)) * ((np.arange(n) + 0.5) / n * 2.0 - 1.0)
    u, v = np.meshgrid(tangent, tangent)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    R, t = T_sensor_model[:3, :3], T_sensor_model[:3, 3]
    query = np.hstack([np.broadcast_to(-R.T @ t, rays.shape), rays @ R]).astype(np.float32)
    ranges = body.scene.cast_rays(o3d.core.Tensor(query))["t_hit"].numpy().astype(np.float64)
    ranges = _with_mixed(ranges.reshape(n, n), sensor.mixed, rng).ravel()
    hit = np.isfinite(ranges)
    measured = ranges[hit] + rng.normal(0.0, sensor.sigma_m, np.count_nonzero(hit))
    wrong = rng.random(len(measured)) < sensor.outliers
    measured[wrong] = np.median(measured) + rng.uniform(-1.0, 1.0, np.count_nonzero(wrong))
    return np.asarray(rays[hit] * measured[:, None])


def line_scan_at(
    body: Body,
    sensor: Sensor,
    pose: Callable[[float], FloatArray],
    end_s: float,
    duration_s: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 3) of a scan and their times (n,) relative to its end; one line of rays at a time.

    ``pose`` returns T_sensor_model (4, 4) at a time, seconds.
    """
    import open3d as o3d

    n = sensor.pixels
    tangent = np.tan(np.radians(0.5 * sensor.field_deg)) * ((np.arange(n) + 0.5) / n * 2.0 - 1.0)
    points, times = [], []
    for line in range(n):
        time_s = -duration_s * (1.0 - (line + 1) / n)
        T = pose(end_s + time_s)
        rays = np.stack([tangent, np.full(n, tangent[line]), np.ones(n)], axis=1)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        R, t = T[:3, :3], T[:3, 3]
        query = np.hstack([np.broadcast_to(-R.T @ t, rays.shape), rays @ R]).astype(np.float32)
        ranges = body.scene.cast_rays(o3d.core.Tensor(query))["t_hit"].numpy().astype(np.float64)
        hit = np.isfinite(ranges)
        noise = rng.normal(0.0, sensor.sigma_m, np.count_nonzero(hit))
        points.append(rays[hit] * (ranges[hit] + noise)[:, None])
        times.append(np.full(np.count_nonzero(hit), time_s))
    return np.concatenate(points), np.concatenate(times)


def surface_points(body: Body, count: int = 5000) -> FloatArray:
    """Return points (count, 3) that are evenly spread over the surface, metres."""
    import open3d as o3d

    o3d.utility.random.seed(0)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(body.vertices), o3d.utility.Vector3iVector(body.triangles)
    )
    return np.asarray(mesh.sample_points_uniformly(count).points)


def random_scan(body: Body, sensor: Sensor, seed: int) -> Scan:
    """Return a scan at a random pose."""
    rng = np.random.default_rng(seed)
    T = random_pose(rng, sensor)
    return Scan(scan_at(body, sensor, T, rng), T)


def model_sample(body: Body, name: str) -> Sample:
    """Return the mesh of a body as the sample of the port model."""
    mesh = Mesh.from_arrays(body.vertices, body.triangles, frame=f"{name}/body", stamp_ns=0)
    return Sample("model", 0, 0, mesh, id=name)


def with_faults(sensor: Sensor) -> Sensor:
    """Return the sensor with a tenth of outliers and mixed pixels along half of the outline."""
    return replace(sensor, mixed=0.5, outliers=0.1)


def _with_mixed(ranges: FloatArray, fraction: float, rng: np.random.Generator) -> FloatArray:
    """Return ranges (r, c) with mixed pixels: a beam on two surfaces measures a range between them."""
    if fraction <= 0.0:
        return ranges
    right = np.roll(ranges, -1, axis=1)
    both = np.isfinite(ranges) & np.isfinite(right) & (np.abs(ranges - right) > 0.1)
    is_mixed = both & (rng.random(ranges.shape) < fraction)
    share = rng.random(ranges.shape)
    difference = np.where(both, right, 0.0) - np.where(both, ranges, 0.0)
    return np.where(is_mixed, ranges + share * difference, ranges)
