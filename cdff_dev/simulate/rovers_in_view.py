# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rovers in the images of other rovers, with their shadows and the dust that they raise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.camera import StereoCamera, View
from cdff_dev.simulate.rover_motion import Motion
from cdff_dev.simulate.rovers_in_view_model import RaisedDust, RoversInView, body_mesh
from cdff_dev.simulate.surface import Float32Array

#: Number of rays per pixel along each image axis, in the window around a body.
_SUBSAMPLES = 3
#: Margin of a window, pixels: wider than the point spread.
_MARGIN_PX = 3
#: Radiance of dust in sunlight; that of a sunlit plain is about 0.7.
_DUST_RADIANCE = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Silhouette:
    """Visible part of a rover in an image.

    Attributes
    ----------
    coverage : NDArray[np.float32], shape (rows, columns)
        Fraction of each pixel that shows the rover.
    whole : float
        Area that would be visible without terrain in front, pixels.
    """

    coverage: Float32Array
    whole: float


class RoverView:
    """Adds the other rovers to the images of a camera.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        The terrain.
    sun : NDArray[np.float64], shape (3,)
        Unit vector to the sun, in site.
    """

    def __init__(
        self,
        model: RoversInView,
        camera: StereoCamera,
        scene: Any,
        motions: Mapping[str, Motion],
        sun: FloatArray,
        ambient: float,
        haze_m: float,
    ) -> None:
        import open3d as o3d

        self._model, self._camera, self._scene, self._motions = model, camera, scene, motions
        self._sun, self._ambient, self._haze_m = np.asarray(sun, float), ambient, haze_m
        self._vertices, triangles, self._albedo = body_mesh(model)
        self._body = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._body.add_triangles(
            o3d.core.Tensor.from_numpy(self._vertices.astype(np.float32)),
            o3d.core.Tensor.from_numpy(triangles),
        )

    def pair(
        self, T_site_base: FloatArray, robot: str, t_s: float, rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return left and right image ``(rows, columns)`` of a robot at ``t_s``, seconds since the epoch."""
        model = self._camera.model
        exposures = self._camera.exposures(rng)
        left, right = (
            self._camera.expose(self.radiance(T_site_base @ T, robot, t_s)[0], float(exposure), rng)
            for T, exposure in zip((model.T_base_left, model.T_base_right), exposures, strict=True)
        )
        return left, right

    def radiance(
        self, T_site_camera: FloatArray, robot: str, t_s: float
    ) -> tuple[Float32Array, dict[str, Silhouette]]:
        """Return an image of a camera and the silhouettes of the other rovers by name.

        The image is the relative radiance ``(rows, columns)``; a sunlit plain has about 0.7.
        """
        model = self._camera.model
        view = self._camera.view(T_site_camera, self._camera.rays)
        image = view.radiance.reshape(model.rows, model.columns).copy()
        depth = view.depth_m.reshape(model.rows, model.columns).copy()
        poses = {
            name: motion.poses(np.array([t_s]))[0] for name, motion in self._motions.items() if name != robot
        }
        silhouettes: dict[str, Silhouette] = {}
        away = {name: float(np.linalg.norm(T[:3, 3] - T_site_camera[:3, 3])) for name, T in poses.items()}
        for name in sorted(poses, key=lambda name: -away[name]):
            self._shade(image, view, T_site_camera, poses[name])
        for name in sorted(poses, key=lambda name: -away[name]):
            silhouette = self._draw(image, depth, T_site_camera, poses[name])
            if silhouette is not None:
                for other in silhouettes:
                    silhouettes[other].coverage[:] *= 1.0 - silhouette.coverage
                silhouettes[name] = silhouette
        if self._model.dust is not None:
            self._add_dust(self._model.dust, image, depth, T_site_camera, poses, t_s)
        return image, silhouettes

    def _window(self, points_m: FloatArray, T_site_camera: FloatArray) -> tuple[slice, slice] | None:
        """Return rows and columns around points in site; None outside the image."""
        model = self._camera.model
        p = se3.transform_points(se3.inverse(T_site_camera), points_m)
        if not (p[:, 2] > 0.3).all():
            return None
        pixels = p[:, :2] / p[:, 2:] * model.focal_px + model.camera_matrix[:2, 2]
        low = np.clip(np.floor(pixels.min(axis=0)) - _MARGIN_PX, 0, [model.columns, model.rows]).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=0)) + _MARGIN_PX + 1, 0, [model.columns, model.rows]).astype(
            int
        )
        if (high <= low).any():
            return None
        return slice(low[1], high[1]), slice(low[0], high[0])

    def _rays(self, window: tuple[slice, slice], n: int) -> FloatArray:
        """Return directions ``(rows * n, columns * n, 3)`` in the camera, depth 1."""
        model = self._camera.model
        v, u = (np.arange(s.start * n, s.stop * n) / n + 0.5 / n - 0.5 for s in window)
        cx, cy = model.camera_matrix[:2, 2]
        uu, vv = np.meshgrid((u - cx) / model.focal_px, (v - cy) / model.focal_px)
        return np.stack([uu, vv, np.ones_like(uu)], axis=-1)

    def _draw(
        self, image: Float32Array, depth: Float32Array, T_site_camera: FloatArray, T_site_body: FloatArray
    ) -> Silhouette | None:
        """Draw a rover into image and depth; return its silhouette, None outside the image."""
        vertices = se3.transform_points(T_site_body, self._vertices)
        window = self._window(vertices, T_site_camera)
        if window is None:
            return None
        n = _SUBSAMPLES
        rays = self._rays(window, n)
        shape = rays.shape[:2]
        directions = (rays.reshape(-1, 3) @ T_site_camera[:3, :3].T).astype(np.float32)
        origin = T_site_camera[:3, 3].astype(np.float32)
        ground = _cast(self._scene, np.broadcast_to(origin, directions.shape), directions)["t_hit"].numpy()
        R = T_site_body[:3, :3]
        local_origin = (R.T @ (T_site_camera[:3, 3] - T_site_body[:3, 3])).astype(np.float32)
        local = (directions @ R).astype(np.float32)
        hits = _cast(self._body, np.broadcast_to(local_origin, local.shape), local)
        t = hits["t_hit"].numpy()
        on_body = np.isfinite(t)
        if not on_body.any():
            return None
        visible = on_body & (t < ground)
        value = np.zeros(len(t), np.float32)
        if visible.any():
            value[visible] = self._light(hits, visible, t, directions, origin, T_site_body)
        blocks = (shape[0] // n, n, shape[1] // n, n)
        coverage = visible.reshape(blocks).mean(axis=(1, 3)).astype(np.float32)
        image[window] = image[window] * (1.0 - coverage) + value.reshape(blocks).mean(axis=(1, 3))
        nearest = np.where(visible, t, np.inf).reshape(blocks).min(axis=(1, 3))
        depth[window] = np.where(coverage > 0.5, nearest, depth[window])
        full = np.zeros_like(image)
        full[window] = coverage
        return Silhouette(full, float(on_body.sum()) / n**2)

    def _light(
        self,
        hits: Any,
        visible: NDArray[np.bool_],
        t: Float32Array,
        directions: Float32Array,
        origin: Float32Array,
        T_site_body: FloatArray,
    ) -> Float32Array:
        """Return the brightness of visible points by Sun and sky, with shadows."""
        R = T_site_body[:3, :3]
        normals = hits["primitive_normals"].numpy()[visible] @ R.T.astype(np.float32)
        facing = np.einsum("ij,ij->i", normals, directions[visible])
        normals = np.where(facing[:, None] > 0.0, -normals, normals)
        points = origin + t[visible, None] * directions[visible] + np.float32(0.01) * normals
        to_sun = np.broadcast_to(self._sun.astype(np.float32), points.shape)
        lit = ~np.isfinite(_cast(self._scene, points, to_sun)["t_hit"].numpy())
        local = ((points - T_site_body[:3, 3]) @ R).astype(np.float32)
        lit &= ~np.isfinite(_cast(self._body, local, (to_sun @ R).astype(np.float32))["t_hit"].numpy())
        cosine = np.clip(normals @ self._sun, 0.0, None) * lit
        albedo = self._albedo[hits["primitive_ids"].numpy()[visible]]
        light = albedo * (self._ambient + (1.0 - self._ambient) * cosine)
        haze = np.exp(-t[visible] / self._haze_m)
        return np.asarray(light * haze + self._camera.sky * (1.0 - haze), dtype=np.float32)

    def _shade(
        self, image: Float32Array, view: View, T_site_camera: FloatArray, T_site_body: FloatArray
    ) -> None:
        """Darken the ground in the shadow of a body."""
        vertices = se3.transform_points(T_site_body, self._vertices)
        low = float(vertices[:, 2].min())
        length = (vertices[:, 2] - low + 0.5) / self._sun[2]
        window = self._window(
            np.concatenate([vertices, vertices - length[:, None] * self._sun]), T_site_camera
        )
        if window is None:
            return
        model = self._camera.model
        shape = (model.rows, model.columns)
        depth = view.depth_m.reshape(shape)[window]
        on_ground = np.isfinite(depth)
        directions = view.directions.reshape(*shape, 3)[window]
        normals = view.normals.reshape(*shape, 3)[window]
        points = np.asarray(view.origin_m) + directions * np.where(on_ground, depth, 0.0)[..., None]
        R = T_site_body[:3, :3]
        local = ((points.reshape(-1, 3) - T_site_body[:3, 3]) @ R).astype(np.float32)
        to_sun = np.broadcast_to((self._sun @ R).astype(np.float32), local.shape)
        hidden = np.isfinite(_cast(self._body, local, to_sun)["t_hit"].numpy()).reshape(depth.shape)
        at = hidden & on_ground
        if not at.any():
            return
        direct = (1.0 - self._ambient) * np.clip(normals[at] @ self._sun, 0.0, None)
        image[window][at] *= (self._ambient / (self._ambient + direct)).astype(np.float32)

    def _add_dust(
        self,
        dust: RaisedDust,
        image: Float32Array,
        depth: Float32Array,
        T_site_camera: FloatArray,
        poses: Mapping[str, FloatArray],
        t_s: float,
    ) -> None:
        """Add the dust that each rover has raised along its path."""
        ages = np.arange(0.0, 4.0 * dust.life_s, dust.period_s) + t_s % dust.period_s
        ages = ages[ages <= t_s]
        for name in poses:
            motion = self._motions[name]
            born = t_s - ages
            distance_m = motion.distance(born + 0.1) - motion.distance(np.maximum(born - 0.1, 0.0))
            for age, T, path in zip(ages, motion.poses(born), distance_m, strict=True):
                # A rover at rest raises none; a cloud has the dust of the path of its period.
                strength = min(float(path) / 0.06, 1.0)
                radius = dust.radius_m + dust.growth_m_s * age
                depth_through = dust.optical_depth * strength * math.exp(-age / dust.life_s)
                depth_through *= (dust.radius_m / radius) ** 2
                if depth_through < 0.01:
                    continue
                centre = T[:3, 3] - 0.4 * T[:3, 0] + np.array([*np.multiply(dust.wind_m_s, age), 0.0])
                self._add_cloud(image, depth, T_site_camera, centre, radius, depth_through)

    def _add_cloud(
        self,
        image: Float32Array,
        depth: Float32Array,
        T_site_camera: FloatArray,
        centre_m: FloatArray,
        radius_m: float,
        optical_depth: float,
    ) -> None:
        """Add a cloud of dust with a Gaussian density in front of the scene."""
        from scipy.special import ndtr

        reach = 3.0 * radius_m * np.concatenate([np.eye(3), -np.eye(3)])
        window = self._window(centre_m + reach, T_site_camera)
        if window is None:
            return
        rays = self._rays(window, 1)
        unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
        centre_in_camera = T_site_camera[:3, :3].T @ (centre_m - T_site_camera[:3, 3])
        along = unit @ centre_in_camera
        off = (centre_in_camera @ centre_in_camera) - along**2
        range_m = depth[window] * np.linalg.norm(rays, axis=2)
        in_front = ndtr((range_m - along) / radius_m)
        thickness = optical_depth * np.exp(-0.5 * np.maximum(off, 0.0) / radius_m**2) * in_front
        passed = np.exp(-thickness).astype(np.float32)
        image[window] = image[window] * passed + np.float32(_DUST_RADIANCE) * (1.0 - passed)


def _cast(scene: Any, origins: NDArray[Any], directions: NDArray[Any]) -> Any:
    import open3d as o3d

    rays = np.empty((len(directions), 6), np.float32)
    rays[:, :3], rays[:, 3:] = origins, directions
    return scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
