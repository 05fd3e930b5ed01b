# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Range of the resolved target: its model, attitude and illumination, and the window of the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.camera import CameraModel
from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_common.stars import sun_position_m
from cdff_common.types import Mesh
from cdff_core.bearing_tracking.camera_attitude import CameraAttitude
from cdff_core.bearing_tracking.lens import distort_directions
from cdff_core.dfns.apparent_size_ranging.interface import (
    ApparentSizeRangingInputs,
    ApparentSizeRangingOutputs,
)
from cdff_core.dfns.star_field_background.interface import StarFieldBackgroundOutputs
from cdff_core.dfpcs.far_range_object_tracking.configuration import FarRangeObjectTrackingConfig

#: Largest extent of the target in the window, pixels (larger images are reduced), and margin on each side,
#: relative to the extent.
_WINDOW_EXTENT_PX, _MARGIN = 110.0, 0.45
_UNITS = {"m": 1.0, "mm": 1e-3, "km": 1e3}
#: Number of directions from which the apparent size of a model is determined.
_VIEWS = 200
#: Variance of each rotation component of an unknown attitude: uniform between -pi and pi.
_UNKNOWN_RAD2 = np.pi**2 / 3.0


@dataclass(frozen=True, slots=True, eq=False)
class TargetModel:
    """Mesh of the target in metres, and its smallest and largest apparent size."""

    name: str
    vertices_m: FloatArray
    triangles: IntArray
    sizes_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TargetRange:
    """Measured range of the target.

    Attributes
    ----------
    range_m, sigma_m : float
    interval_m : ndarray (2,)
        Ranges that the apparent size permits.
    T_camera_body : UncertainTransform
    body : str
        Name of the target.
    reasons : tuple of str
        Restrictions: ``range_interval`` without the attitude of the target, ``range_uninformative`` above the
        limit of the configuration.
    size_m : float
        Largest size of the target.
    inputs : tuple of str
        Ids of the samples.
    """

    range_m: float
    sigma_m: float
    interval_m: FloatArray
    T_camera_body: UncertainTransform
    body: str
    reasons: tuple[str, ...]
    size_m: float
    inputs: tuple[str, ...]

    @property
    def metrics(self) -> dict[str, float]:
        """Bounds of the range, metres, and its relative standard deviation."""
        low, high = self.interval_m.tolist()
        return {"range_low_m": low, "range_high_m": high, "range_relative_sigma": self.sigma_m / self.range_m}


class TargetRanging:
    """Ranging of the resolved target of the images of one camera."""

    def __init__(self, measure: Dfn[Any, Any, Any], config: FarRangeObjectTrackingConfig) -> None:
        self._measure, self._config = measure, config
        self._model: TargetModel | None = None
        self._attitude: Sample | None = None
        self._sun: Sample | None = None
        self._model_id: tuple[str, ...] = ()

    def give_model(self, sample: Sample) -> None:
        """Store the mesh of the target.

        Raises
        ------
        InputError, DegenerateGeometryError
            If it has no triangle, a coordinate is not finite, or it has no extent.
        """
        self._model = target_model(sample.value, _UNITS[self._config.model_unit])
        self._model_id = (sample.id,) if sample.id else ()

    def give_attitude(self, sample: Sample) -> None:
        """Store T_inertial_body."""
        self._attitude = sample

    def give_sun(self, sample: Sample) -> None:
        """Store the direction of the Sun.

        Raises
        ------
        InputError
            If it is not finite or zero.
        """
        direction = np.asarray(sample.value.values, float)
        if not (np.isfinite(direction).all() and np.linalg.norm(direction) > 0.0):
            raise InputError(f"sun {direction.tolist()}: expected a finite direction")
        self._sun = sample

    @property
    def has_size(self) -> bool:
        """True if the size of the target is known."""
        return self._model is not None or self._config.target_sizes_m is not None

    def measure(
        self,
        stamp_ns: int,
        camera: CameraModel,
        attitude: CameraAttitude,
        image: StarFieldBackgroundOutputs,
        box: FloatArray,
        point_spread: FloatArray,
    ) -> TargetRange:
        """Return the range of the body in a box (4,): first and last column, first and last row.

        Raises
        ------
        RefusedError
            If the body is not resolved.
        """
        window = _Window.around(camera, attitude, image, box, point_spread)
        R_inertial_body, sun, inputs = self._attitude_and_sun(stamp_ns)
        R: FloatArray | None = None
        to_sun: FloatArray | None = None
        if attitude.rotation is not None:
            R_window_inertial = window.R_window_camera @ attitude.rotation.T
            to_sun = R_window_inertial @ sun
            R = None if R_inertial_body is None else R_window_inertial @ R_inertial_body
        model = self._model
        reasons: tuple[str, ...] = ()
        sizes = self._config.target_sizes_m if model is None else model.sizes_m
        values: dict[str, Any] = {
            "image": window.image,
            "noise": window.noise,
            "focal": window.focal_px,
            "point_spread": window.point_spread_px,
            "sizes": np.array(sizes, float),
            "sun": to_sun,
        }
        try:
            if model is None or R is None:
                raise RefusedError("attitude of the target unknown", reasons=["range_interval"])
            size_range = self._measure.process(
                ApparentSizeRangingInputs(
                    **values, vertices=model.vertices_m, triangles=model.triangles, attitude=R
                )
            )
        except RefusedError as refusal:
            if any(reason.startswith("unresolved") for reason in refusal.reasons):
                raise
            R, reasons = None, tuple(dict.fromkeys([*refusal.reasons, "range_interval"]))
            size_range = self._measure.process(ApparentSizeRangingInputs(**values))
        size_m = float(values["sizes"][1])
        relative, limit = size_range.range_sigma / size_range.range, self._config.informative_range
        if relative > limit:
            reasons += (f"range_uninformative:{relative:.2f}>{limit:g}",)
        T = window.transform(size_range, R)
        name = "target" if model is None else model.name
        return TargetRange(
            size_range.range,
            size_range.range_sigma,
            size_range.interval,
            T,
            name,
            reasons,
            size_m,
            (*self._model_id, *(inputs if R is not None else ())),
        )

    def _attitude_and_sun(self, stamp_ns: int) -> tuple[FloatArray | None, FloatArray, tuple[str, ...]]:
        """Return R_inertial_body at a time or None, the direction of the Sun, and the ids of the samples."""
        attitude_sample, R = self._attitude, None
        inputs: tuple[str, ...] = ()
        if (
            attitude_sample is not None
            and abs(stamp_ns - attitude_sample.stamp_ns) <= self._config.body_attitude_age_s * 1e9
        ):
            R, inputs = attitude_sample.value.transform.matrix[:3, :3], (attitude_sample.id,)
        sun = sun_position_m(stamp_ns) if self._sun is None else np.asarray(self._sun.value.values, float)
        return R, sun / np.linalg.norm(sun), inputs


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """Image of a virtual pinhole camera that looks at the target."""

    image: Any
    noise: float
    focal_px: float
    point_spread_px: float
    R_window_camera: FloatArray

    @classmethod
    def around(
        cls,
        camera: CameraModel,
        attitude: CameraAttitude,
        image: StarFieldBackgroundOutputs,
        box: FloatArray,
        point_spread: FloatArray,
    ) -> _Window:
        """Return the window of a box, without distortion; a large target is reduced."""
        centre = np.array([0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])])
        extent = max(float(box[1] - box[0]), float(box[3] - box[2])) + 1.0
        factor = max(extent / _WINDOW_EXTENT_PX, 1.0)
        side = int(np.ceil(extent / factor * (1.0 + 2.0 * _MARGIN))) + 16
        rays = camera.rays(centre[None])
        z = rays[0]
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        R = np.stack([x, np.cross(z, x), z])
        focal = camera.fx / factor
        u = (np.arange(side) - 0.5 * (side - 1)) / focal
        grid = np.stack([*np.meshgrid(u, u), np.ones((side, side))], axis=-1).reshape(-1, 3) @ R
        grid /= np.linalg.norm(grid, axis=1, keepdims=True)
        pixels = camera.project(distort_directions(grid, attitude.scale, attitude.radial))
        pixels = pixels.reshape(side, side, 2).astype(np.float32)
        residual = image.residual
        if factor > 1.0:
            residual = np.asarray(cv2.GaussianBlur(residual, (0, 0), 0.5 * factor), np.float32)
        light = cv2.remap(residual, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR)
        rows, columns = image.noise.shape
        row, column = (
            int(np.clip(round(float(c)), 0, n - 1)) for c, n in ((centre[1], rows), (centre[0], columns))
        )
        # The smoothing before the reduction, 0.5 * factor pixels, adds to the point spread.
        smoothing_px = 0.5 * factor if factor > 1.0 else 0.0
        spread_px = np.sqrt(0.5 * np.trace(point_spread) + smoothing_px**2)
        return cls(
            image=np.nan_to_num(light),
            noise=max(float(image.noise[row, column]) / factor, 1e-6),
            focal_px=focal,
            point_spread_px=float(spread_px / factor),
            R_window_camera=R,
        )

    def transform(
        self, size_range: ApparentSizeRangingOutputs, R_window_body: FloatArray | None
    ) -> UncertainTransform:
        """Return T_camera_body with covariance."""
        middle = 0.5 * (np.array(self.image.shape[::-1]) - 1.0)
        position_px = middle if R_window_body is None else size_range.origin
        ray = np.append((position_px - middle) / self.focal_px, 1.0)
        ray = self.R_window_camera.T @ (ray / np.linalg.norm(ray))
        # Across the line of sight: the error of an edge; without attitude a part of the extent.
        across_px = 0.25 * size_range.extent if R_window_body is None else 0.5
        covariance = np.zeros((6, 6))
        along = np.outer(ray, ray)
        covariance[:3, :3] = size_range.range_sigma**2 * along
        covariance[:3, :3] += (size_range.range * across_px / self.focal_px) ** 2 * (np.eye(3) - along)
        covariance[3:, 3:] = np.eye(3) * (_UNKNOWN_RAD2 if R_window_body is None else 1e-4)
        R = np.eye(3) if R_window_body is None else self.R_window_camera.T @ R_window_body
        return UncertainTransform(se3.transform(R, size_range.range * ray), covariance)


def target_model(mesh: Mesh, scale: float) -> TargetModel:
    """Return the model of a mesh with a unit of ``scale`` metres."""
    vertices = scale * np.asarray(mesh.data.vertices, np.float64)
    triangles = np.asarray(mesh.data.triangles, np.int64)
    name = mesh.frame.removesuffix("/body") or "target"
    if not len(triangles):
        raise InputError(f"model {name}: {len(vertices)} vertices and no triangle, expected a mesh")
    if not np.isfinite(vertices).all():
        raise InputError(f"model {name}: a vertex is NaN or infinite, expected finite coordinates")
    return TargetModel(name, vertices, triangles, apparent_sizes_m(vertices))


def apparent_sizes_m(vertices_m: FloatArray) -> FloatArray:
    """Return the smallest and the largest apparent size (2,) of a body over all directions of view.

    The apparent size is the largest distance of two points of the projection along the direction of view.

    Raises
    ------
    DegenerateGeometryError
        If the vertices (n, 3) are in one plane.
    """
    try:
        hull = vertices_m[ConvexHull(vertices_m).vertices]
    except QhullError as error:
        raise DegenerateGeometryError(f"model: {len(vertices_m)} vertices without volume") from error
    k = np.arange(_VIEWS) + 0.5
    z = 1.0 - 2.0 * k / _VIEWS
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    views = np.column_stack([np.sqrt(1.0 - z * z) * np.cos(angle), np.sqrt(1.0 - z * z) * np.sin(angle), z])
    hull = hull[
        np.unique(np.concatenate([np.argmax(hull @ views.T, axis=0), np.argmin(hull @ views.T, axis=0)]))
    ]
    difference = hull[:, None] - hull
    square = (difference**2).sum(axis=-1)
    # The largest distance of two projected points, for each direction of view.
    largest_squares = [float((square - (difference @ view) ** 2).max()) for view in views]
    return np.sqrt([min(largest_squares), float(square.max())])
