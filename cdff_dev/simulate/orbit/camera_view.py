# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Radiance of the bodies and the Earth in the pixels of a camera, before lens and detector."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.body_scene import BodyScene, Hits
from cdff_dev.simulate.orbit.materials import Float32Array
from cdff_dev.simulate.orbit.sensors import Camera
from cdff_dev.simulate.orbit.world import PlacedBody

#: Diameter of a body, pixels, below which its surface is sampled by points instead of pixels, and the number
#: of points along an edge of its bounding square.
SMALL_PX, _POINTS = 32.0, 80


@dataclass(frozen=True, slots=True, eq=False)
class PointSources:
    """Light of a body that is small in the image.

    Attributes
    ----------
    number, name : int, str
        Of the body.
    pixels : ndarray (n, 2)
    radiance_sr : ndarray (n,)
        Radiance times solid angle: irradiance at the lens relative to that of the Sun at 1 au.
    points_m : ndarray (n, 3)
        Camera axes.
    """

    number: int
    name: str
    pixels: FloatArray
    radiance_sr: FloatArray
    points_m: FloatArray


@dataclass(slots=True, eq=False)
class View:
    """Visible surfaces of an image.

    Attributes
    ----------
    radiance : ndarray float32 (rows, columns)
        1/sr, relative to the irradiance of the Sun at 1 au; of bodies larger than ``SMALL_PX``.
    number : ndarray uint8 (rows, columns)
        Body in each pixel, 0 for none.
    points_m : ndarray float32 (rows, columns, 3)
        Visible points in camera axes at the time of their row; 0 without a body.
    sources : list of PointSources
    """

    radiance: Float32Array
    number: NDArray[np.uint8]
    points_m: Float32Array
    sources: list[PointSources] = field(default_factory=list)


class CameraRays:
    """Rays of the pixels of a camera."""

    def __init__(self, model: Camera) -> None:
        self.model = model
        rows, columns = model.rows, model.columns
        v, u = np.mgrid[0:rows, 0:columns]
        camera = model.model
        rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
        # A strong distortion may leave single border pixels without a ray: they look along their neighbours.
        rays[~np.isfinite(rays).all(axis=1)] = [0.0, 0.0, 1.0]
        self.directions: Float32Array = rays.astype(np.float32)
        grid = rays.reshape(rows, columns, 3)
        along_u, along_v = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
        #: Solid angle of each pixel, sr.
        self.solid_angle: Float32Array = np.linalg.norm(np.cross(along_u, along_v), axis=2).astype(np.float32)
        self.row = np.repeat(np.arange(rows, dtype=np.intp), columns)

    def render(self, bodies: list[PlacedBody]) -> View:
        """Return the view of bodies with poses at one time, or at the time of each row."""
        rows, columns = self.model.rows, self.model.columns
        view = View(
            np.zeros((rows, columns), np.float32),
            np.zeros((rows, columns), np.uint8),
            np.zeros((rows, columns, 3), np.float32),
        )
        depth = np.full(rows * columns, np.inf, dtype=np.float32)
        T_camera_base = se3.inverse(self.model.T_base_camera)
        small: list[tuple[PlacedBody, FloatArray]] = []
        for body in bodies:
            T_camera_body = T_camera_base @ body.T_base_body
            _centre, distance_m = _middle_centre(body.scene, T_camera_body)
            diameter_px = 2.0 * body.scene.radius_m / max(distance_m, 1e-9) * self.model.focal_px
            if diameter_px < SMALL_PX:
                small.append((body, T_camera_body))
                continue
            self._add_body(view, depth, body, T_camera_body, _other_bodies(body, bodies))
        for body, T_camera_body in small:
            self._add_small(view, depth, body, T_camera_body, _other_bodies(body, bodies))
        return view

    def _add_body(
        self,
        view: View,
        depth: Float32Array,
        body: PlacedBody,
        T_camera_body: FloatArray,
        others: tuple[tuple[BodyScene, FloatArray], ...],
    ) -> None:
        """Add a body that covers many pixels."""
        pixels = self._candidates(body.scene, T_camera_body)
        if not len(pixels):
            return
        of_pose = self.row if len(T_camera_body) > 1 else None
        hits = body.scene.cast(self.directions, se3.inverse(T_camera_body), pixels, of_pose)
        nearer = hits.distance_m < depth[pixels[hits.ray]]
        hits = _select(hits, nearer)
        at = pixels[hits.ray]
        depth[at] = hits.distance_m
        view.number.ravel()[at] = body.number
        view.points_m.reshape(-1, 3)[at] = self.directions[at] * hits.distance_m[:, None]
        view.radiance.ravel()[at] = body.scene.radiance(hits, body.light, others)

    def _candidates(self, scene: BodyScene, T_camera_body: FloatArray) -> NDArray[np.intp]:
        """Return the pixels in the rectangle of the projected bounding box of a body at its poses.

        They are all pixels if a corner is behind the camera or far off its axis, where the lens model ends.
        """
        rows, columns = self.model.rows, self.model.columns
        T = T_camera_body[[0, len(T_camera_body) // 2, -1]] if len(T_camera_body) > 1 else T_camera_body
        corners = np.einsum("pij,kj->pki", T[:, :3, :3], scene.corners_m) + T[:, None, :3, 3]
        corners = corners.reshape(-1, 3)
        if (corners[:, 2] < 0.3 * np.linalg.norm(corners, axis=1)).any():
            return np.arange(rows * columns)
        pixels = self.model.model.project(corners)
        margin = 2.0 + 0.05 * np.ptp(pixels, axis=0) * (len(T) > 1 or self.model.distortion != ())
        low = np.clip(np.floor(pixels.min(axis=0) - margin), 0, [columns, rows]).astype(np.intp)
        high = np.clip(np.ceil(pixels.max(axis=0) + margin) + 1, 0, [columns, rows]).astype(np.intp)
        row, column = np.arange(low[1], high[1]), np.arange(low[0], high[0])
        return (row[:, None] * columns + column).ravel()

    def _add_small(
        self,
        view: View,
        depth: Float32Array,
        body: PlacedBody,
        T_camera_body: FloatArray,
        others: tuple[tuple[BodyScene, FloatArray], ...],
    ) -> None:
        """Add a body that covers few pixels: a bundle of rays from the camera through its bounding square."""
        scene = body.scene
        T = T_camera_body[len(T_camera_body) // 2]
        if len(T_camera_body) > 1:
            # Rolling shutter: the pose at the row of the body.
            centre = T[:3, :3] @ scene.centre_m + T[:3, 3]
            row = self.model.model.project(centre)[0, 1]
            if np.isfinite(row):
                T = T_camera_body[int(np.clip(round(row), 0, len(T_camera_body) - 1))]
        centre = T[:3, :3] @ scene.centre_m + T[:3, 3]
        distance_m = float(np.linalg.norm(centre))
        if centre[2] <= 0.0 or distance_m <= scene.radius_m:
            return
        axis = centre / distance_m
        across = np.cross([0.0, 1.0, 0.0], axis)
        across /= np.linalg.norm(across)
        half = scene.radius_m / distance_m
        offset = ((np.arange(_POINTS) + 0.5) / _POINTS * 2.0 - 1.0) * half
        b, a = (g.ravel() for g in np.meshgrid(offset, offset, indexing="ij"))
        rays = axis + np.outer(a, across) + np.outer(b, np.cross(axis, across))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        hits = scene.cast(rays.astype(np.float32), se3.inverse(T)[None])
        if not len(hits.ray):
            return
        radiance = body.scene.radiance(hits, body.light, others)
        at = self.model.model.project(rays[hits.ray])
        points = rays[hits.ray] * hits.distance_m[:, None]
        column, row = np.rint(at).astype(np.int64).T
        inside = (column >= 0) & (column < self.model.columns) & (row >= 0) & (row < self.model.rows)
        flat = np.where(inside, row * self.model.columns + column, 0)
        visible = ~inside | (hits.distance_m < depth[flat])
        visible_pixels = flat[inside & visible]
        view.number.ravel()[visible_pixels] = body.number
        sample_sr = (2.0 * half / _POINTS) ** 2
        view.sources.append(
            PointSources(
                body.number,
                body.name,
                at[visible],
                radiance[visible].astype(float) * sample_sr,
                points[visible],
            )
        )


def _middle_centre(scene: BodyScene, T_camera_body: FloatArray) -> tuple[FloatArray, float]:
    """Return the centre of a body in the middle of the exposure, and its distance, metres."""
    T = T_camera_body[len(T_camera_body) // 2]
    centre = T[:3, :3] @ scene.centre_m + T[:3, 3]
    return centre, float(np.linalg.norm(centre))


def _other_bodies(body: PlacedBody, bodies: list[PlacedBody]) -> tuple[tuple[BodyScene, FloatArray], ...]:
    """Return the other bodies with ``T_other_body``, for shadows."""
    T_base_body = body.T_base_body[len(body.T_base_body) // 2]
    return tuple(
        (o.scene, se3.inverse(o.T_base_body[len(o.T_base_body) // 2]) @ T_base_body)
        for o in bodies
        if o.number != body.number
    )


def _select(hits: Hits, keep: NDArray[np.bool_]) -> Hits:
    """Return the hits of a mask."""
    if keep.all():
        return hits
    return Hits(
        hits.ray[keep],
        hits.distance_m[keep],
        hits.points_m[keep],
        hits.normals[keep],
        hits.to_eye[keep],
        hits.material[keep],
    )
