# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of the products of a mission in orbit with the ground truth: poses, bearings and model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.client import Client
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.product import Status
from cdff_common.types import Mesh
from cdff_dev.logs import open_log
from cdff_dev.missions.orbit.ray_scene import RaySurface
from cdff_dev.missions.orbit.script import OrbitLimits
from cdff_dev.simulate.orbit.meshes import BodyMesh

#: Number of points on the true surface at which the completeness of a model is computed.
_SURFACE_POINTS = 4000
#: Label of the track whose object has a size that fits the client.
_TARGET = "target"
#: Largest number of products in one search.
_PAGE = 1000


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of the poses of one DFPC relative to the truth at the same times.

    Attributes
    ----------
    dfpc : str
    stamps_ns : ndarray int64 (n,)
    distances_m : ndarray (n,)
        True distance between sensor and body.
    errors : ndarray (n, 6)
        Translation, metres, and rotation vector, rad, in the frame of the sensor.
    covariances : ndarray (n, 6, 6)
    statuses : list of str
    """

    dfpc: str
    stamps_ns: NDArray[np.int64]
    distances_m: FloatArray
    errors: FloatArray
    covariances: FloatArray
    statuses: Sequence[str]

    @property
    def position_m(self) -> FloatArray:
        """Lengths (n,) of the position errors."""
        return np.asarray(np.linalg.norm(self.errors[:, :3], axis=1))

    @property
    def rotation_deg(self) -> FloatArray:
        """Angles (n,) of the rotation errors."""
        return np.asarray(np.degrees(np.linalg.norm(self.errors[:, 3:], axis=1)))

    @property
    def sigma_m(self) -> FloatArray:
        """Stated standard deviations (n,) of the position in the worst direction."""
        return np.asarray(np.sqrt(np.linalg.eigvalsh(self.covariances[:, :3, :3])[:, -1]))

    @property
    def sigma_deg(self) -> FloatArray:
        """Stated standard deviations (n,) of the rotation in the worst direction."""
        return np.asarray(np.degrees(np.sqrt(np.linalg.eigvalsh(self.covariances[:, 3:, 3:])[:, -1])))

    @property
    def nees(self) -> FloatArray:
        """Squared errors (n,) normalised by the stated covariance; 6 are expected."""
        solved = np.linalg.solve(self.covariances, self.errors[:, :, None])[:, :, 0]
        return np.asarray(np.einsum("ni,ni->n", self.errors, solved))

    @property
    def within_three_sigma(self) -> float:
        """Fraction of the poses with errors of position and rotation within three standard deviations."""
        inside = (self.position_m <= 3.0 * self.sigma_m) & (self.rotation_deg <= 3.0 * self.sigma_deg)
        return float(np.mean(inside)) if len(inside) else 0.0

    def flagged_failures(self, limits: OrbitLimits) -> tuple[int, int]:
        """Return the number of poses with errors above five times the limits, and how many are not OK."""
        wrong = (self.position_m > 5.0 * limits.position_m) | (self.rotation_deg > 5.0 * limits.rotation_deg)
        flagged = sum(self.statuses[int(i)] != Status.OK for i in np.flatnonzero(wrong))
        return int(wrong.sum()), flagged

    def summary(self) -> dict[str, Any]:
        """Return the figures as plain data; None without poses."""
        if not len(self.stamps_ns):
            return {"dfpc": self.dfpc, "poses": 0}
        return {
            "dfpc": self.dfpc,
            "poses": len(self.stamps_ns),
            "distance_m": [float(self.distances_m.min()), float(self.distances_m.max())],
            "position_m": _quantiles(self.position_m),
            "rotation_deg": _quantiles(self.rotation_deg),
            "sigma_m": float(np.median(self.sigma_m)),
            "sigma_deg": float(np.median(self.sigma_deg)),
            "nees_median": float(np.median(self.nees)),
            "nees_mean": float(np.mean(self.nees)),
            "within_three_sigma": self.within_three_sigma,
            "degraded": sum(status != Status.OK for status in self.statuses),
        }

    def __str__(self) -> str:
        if not len(self.stamps_ns):
            return f"{self.dfpc}: no pose"
        return (
            f"{self.dfpc}: {len(self.stamps_ns)} poses at {self.distances_m.min():.1f} to "
            f"{self.distances_m.max():.1f} m; error median {1e3 * np.median(self.position_m):.1f} mm, "
            f"{np.median(self.rotation_deg):.2f}°, largest {1e3 * self.position_m.max():.1f} mm, "
            f"{self.rotation_deg.max():.2f}°; {self.within_three_sigma:.0%} within three sigmas; "
            f"NEES median {np.median(self.nees):.1f} (5.3 expected)"
        )


@dataclass(frozen=True, slots=True, eq=False)
class BearingErrors:
    """Errors of the bearings and ranges of far-range tracking.

    Attributes
    ----------
    stamps_ns : ndarray int64 (n,)
    ranges_m : ndarray (n,)
        True ranges from the camera.
    errors_rad, sigmas_rad : ndarray (n, 2)
        Azimuth (times the cosine of the elevation) and elevation, inertial axes.
    low_m, high_m : ndarray (n,)
        Stated interval of the range; NaN if it is unobservable.
    """

    stamps_ns: NDArray[np.int64]
    ranges_m: FloatArray
    errors_rad: FloatArray
    sigmas_rad: FloatArray
    low_m: FloatArray
    high_m: FloatArray

    @property
    def range_contained(self) -> float:
        """Fraction of the stated intervals that contain the true range; NaN without an interval."""
        stated = np.isfinite(self.low_m) & np.isfinite(self.high_m)
        if not stated.any():
            return float("nan")
        inside = (self.low_m <= self.ranges_m) & (self.ranges_m <= self.high_m)
        return float(np.mean(inside[stated]))

    def summary(self) -> dict[str, Any]:
        """Return the figures as plain data."""
        if not len(self.stamps_ns):
            return {"bearings": 0}
        error_rad = np.linalg.norm(self.errors_rad, axis=1)
        return {
            "bearings": len(self.stamps_ns),
            "range_m": [float(self.ranges_m.min()), float(self.ranges_m.max())],
            "bearing_arcsec": _quantiles(np.degrees(error_rad) * 3600.0),
            "sigma_arcsec": float(np.median(np.degrees(self.sigmas_rad)) * 3600.0),
            "range_contained": self.range_contained,
        }

    def __str__(self) -> str:
        if not len(self.stamps_ns):
            return "far_range_object_tracking: no bearing"
        figures = self.summary()
        arcsec = figures["bearing_arcsec"]
        return (
            f"far_range_object_tracking: {figures['bearings']} bearings at {figures['range_m'][0]:.0f} to "
            f"{figures['range_m'][1]:.0f} m; error median {arcsec['median']:.0f}″, largest "
            f"{arcsec['largest']:.0f}″; {self.range_contained:.0%} of the range intervals contain the range"
        )


@dataclass(frozen=True, slots=True, eq=False)
class ModelErrors:
    """Distances of the vertices of a delivered model from the true surface, and its completeness.

    Attributes
    ----------
    model : Mesh
    distances_m : ndarray (n,)
        Of the vertices.
    within_m : float
        Distance within which a point of the true surface counts as reconstructed.
    completeness : float
        Fraction of the outer surface.
    """

    model: Mesh
    distances_m: FloatArray
    within_m: float
    completeness: float

    @property
    def rms_m(self) -> float:
        """Root mean square distance."""
        return float(np.sqrt(np.mean(self.distances_m**2)))

    def summary(self) -> dict[str, Any]:
        """Return the figures as plain data."""
        return {
            "vertices": len(self.distances_m),
            "triangles": len(self.model.data.triangles),
            "rms_m": self.rms_m,
            "median_m": float(np.median(self.distances_m)),
            "completeness": self.completeness,
            "within_m": self.within_m,
        }

    def __str__(self) -> str:
        return (
            f"delivered model: {len(self.model.data.triangles)} triangles; distance from the true surface "
            f"RMS {1e3 * self.rms_m:.1f} mm, median {1e3 * np.median(self.distances_m):.1f} mm; "
            f"{self.completeness:.0%} of the outer surface within {self.within_m:g} m"
        )


def pose_errors(client: Client, log: Path, robot: str, dfpc: str, sensor: str, body: str) -> PoseErrors:
    """Return the errors of the poses of a DFPC in the DPM, at the times of the samples of a sensor."""
    truth = _true_poses(log, f"/{robot}/truth.{sensor}_target", body)
    stamps, errors, covariances, distances, statuses = [], [], [], [], []
    for product in _all_products(client, "pose", robot, dfpc):
        stamp_ns = product.header.t1_ns
        if stamp_ns not in truth or product.header.child != f"{body}/body":
            continue
        estimate = client.get(product.id).value.transform
        if estimate.covariance is None:
            continue
        stamps.append(stamp_ns)
        errors.append(pose_error(truth[stamp_ns], estimate.matrix))
        covariances.append(estimate.covariance)
        distances.append(np.linalg.norm(truth[stamp_ns][:3, 3]))
        statuses.append(str(product.header.quality.status))
    return PoseErrors(
        dfpc,
        np.array(stamps, dtype=np.int64),
        np.array(distances),
        np.array(errors).reshape(-1, 6),
        np.array(covariances).reshape(-1, 6, 6),
        statuses,
    )


def bearing_errors(client: Client, log: Path, robot: str, camera: str, body: str) -> BearingErrors:
    """Return the errors of the tracks of the target by far_range_object_tracking, inertial axes."""
    truth = _true_poses(log, f"/{robot}/truth.{camera}_target", body)
    attitudes = _true_attitudes(log, robot)
    rows = []
    T_base_camera = None
    for product in _all_products(client, "track", robot, "far_range_object_tracking"):
        stamp_ns = product.header.t1_ns
        if product.header.frame != "inertial" or stamp_ns not in truth or stamp_ns not in attitudes:
            continue
        if T_base_camera is None:
            T_base_camera = client.pose(
                robot, parent=f"{robot}/base", child=f"{robot}/{camera}", t_ns=stamp_ns
            ).matrix
        answer = client.get(product.id)
        if not len(answer.value.data.bearings) or answer.value.metadata.label != _TARGET:
            continue
        azimuth, elevation, sigma_a, sigma_e, _, _ = answer.value.data.bearings[-1].tolist()
        line = attitudes[stamp_ns] @ T_base_camera[:3, :3] @ truth[stamp_ns][:3, 3]
        range_m = float(np.linalg.norm(line))
        true_azimuth, true_elevation = np.arctan2(line[1], line[0]), np.arcsin(line[2] / range_m)
        wrapped = (azimuth - true_azimuth + np.pi) % (2.0 * np.pi) - np.pi
        metrics = answer.header.quality.metrics
        low_m, high_m = (float(metrics.get(f"range_{end}_m", np.nan)) for end in ("low", "high"))
        cosine = np.cos(true_elevation)
        rows.append(
            (
                stamp_ns,
                range_m,
                wrapped * cosine,
                elevation - true_elevation,
                sigma_a * cosine,
                sigma_e,
                low_m,
                high_m,
            )
        )
    table = np.array([row[1:] for row in rows]).reshape(-1, 7)
    stamps_ns = np.array([row[0] for row in rows], dtype=np.int64)
    return BearingErrors(stamps_ns, table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5], table[:, 6])


def model_errors(model: Mesh, body: BodyMesh, within_m: float) -> ModelErrors:
    """Return the errors of a model in the frame of the body, relative to its true mesh."""
    distances_m = RaySurface(body.vertices_m, body.triangles).distances(model.data.vertices)
    points = _outer_points(body)
    covered = RaySurface(model.data.vertices, model.data.triangles).distances(points) <= within_m
    return ModelErrors(model, distances_m, within_m, float(np.mean(covered)))


def true_distances(log: Path, robot: str, body: str) -> tuple[NDArray[np.int64], FloatArray]:
    """Return times (n,) and true distances (n,), metres, between the servicer and a body."""
    positions = []
    with closing(open_log(log)) as reader:
        for owner in (robot, body):
            samples = reader.samples([f"/{owner}/truth.pose"])
            positions.append({s.stamp_ns: s.value.transform.matrix[:3, 3] for s in samples})
    stamps_ns = np.array(sorted(positions[0].keys() & positions[1].keys()), dtype=np.int64)
    offsets = np.array([positions[0][int(t)] - positions[1][int(t)] for t in stamps_ns]).reshape(-1, 3)
    return stamps_ns, np.linalg.norm(offsets, axis=1)


def _all_products(client: Client, product: str, robot: str, dfpc: str) -> Iterator[Any]:
    """Yield the products of a DFPC in the order of their capture times."""
    found: list[Any] = []
    cursor: dict[str, object] = {}
    while True:
        page = client.search(product, robot=robot, dfpc=dfpc, limit=_PAGE, **cursor)
        found += page
        if len(page) < _PAGE:
            break
        cursor = {"t1": min(item.header.t1_ns for item in page) - 1000}
    unique = {item.id: item for item in found}
    yield from sorted(unique.values(), key=lambda item: int(item.header.t1_ns))


def _true_poses(log: Path, stream: str, body: str) -> dict[int, FloatArray]:
    """Return ``T_sensor_body`` (4, 4) by stamp."""
    poses = {}
    with closing(open_log(log)) as reader:
        for sample in reader.samples([stream]):
            detection = next(d for d in sample.value.detections if d.label == body)
            poses[sample.stamp_ns] = detection.pose.transform.matrix
    return poses


def _true_attitudes(log: Path, robot: str) -> dict[int, FloatArray]:
    """Return ``R_inertial_base`` (3, 3) by stamp."""
    with closing(open_log(log)) as reader:
        samples = reader.samples([f"/{robot}/truth.pose"])
        return {s.stamp_ns: s.value.transform.matrix[:3, :3] for s in samples}


def _outer_points(body: BodyMesh) -> FloatArray:
    """Return points (n, 3) of the surface that are visible from outside: first hits of rays from a sphere."""
    rng = np.random.default_rng(0)
    centre = 0.5 * (body.vertices_m.min(axis=0) + body.vertices_m.max(axis=0))
    radius_m = float(np.linalg.norm(body.vertices_m - centre, axis=1).max())
    outward = rng.normal(size=(_SURFACE_POINTS * 4, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    target = centre + radius_m * rng.uniform(-1.0, 1.0, outward.shape)
    origin = centre + 3.0 * radius_m * outward
    direction = target - origin
    fraction, _, _ = RaySurface(body.vertices_m, body.triangles).cast(origin, direction)
    hit = np.isfinite(fraction)
    return np.asarray((origin + fraction[:, None] * direction)[hit][:_SURFACE_POINTS])


def _quantiles(values: FloatArray) -> dict[str, float]:
    return {
        "median": float(np.median(values)),
        "p95": float(np.quantile(values, 0.95)),
        "largest": float(values.max()),
    }
