# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated stereo camera: one ray per pixel, texture lookups, optics and sensor noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.scenario import Navcam
from cdff_dev.simulate.surface import Appearance, Float32Array, sample


class StereoCamera:
    """Renders the stereo pairs of the navcam of a scenario.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Geometry 0 is the ground, 1 the rocks.
    ground_vertices : int
        Number of vertices of geometry 0, which is the index of the first rock vertex in
        ``Appearance.vertex_radiance``.
    triangles : tuple of NDArray[np.uint32]
        Vertex indices of the triangles of ground and rocks, (m, 3) each.
    """

    def __init__(
        self,
        model: Navcam,
        scene: Any,
        appearance: Appearance,
        ground_vertices: int,
        triangles: tuple[NDArray[np.uint32], ...],
    ) -> None:
        self._model = model
        self._scene = scene
        self._appearance = appearance
        self._rock_start = ground_vertices
        self._triangles = triangles
        K = model.camera_matrix
        v, u = np.mgrid[0 : model.rows, 0 : model.columns]
        rays = np.stack(
            [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u, dtype=float)], axis=-1
        )
        self._rays = rays.reshape(-1, 3)
        self._ray_length = np.linalg.norm(self._rays, axis=1).astype(np.float32)
        corner_off_axis = (K[0, 2] ** 2 + K[1, 2] ** 2) / K[0, 0] ** 2
        off_axis = ((self._rays[:, :2] ** 2).sum(1) / corner_off_axis).reshape(model.rows, model.columns)
        self._vignette = (1.0 - model.vignetting * off_axis).astype(np.float32)

    def pair(
        self, T_site_base: FloatArray, rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return left and right image ``(rows, columns)`` of a rover at the pose ``T_site_base``."""
        m = self._model
        exposure = 1.0 + m.exposure_sigma * rng.standard_normal()
        balance = 1.0 + m.balance_sigma * rng.standard_normal(2)
        left = self._expose(self.radiance(T_site_base @ m.T_base_left), exposure * balance[0], rng)
        right = self._expose(self.radiance(T_site_base @ m.T_base_right), exposure * balance[1], rng)
        return left, right

    def depth(self, T_site_camera: FloatArray) -> Float32Array:
        """Return the depth along the optical axis ``(rows, columns)``, metres; infinite for the sky."""
        hit: Float32Array = self._cast(T_site_camera)[0]["t_hit"].numpy()
        return hit.reshape(self._model.rows, self._model.columns)

    def radiance(self, T_site_camera: FloatArray) -> Float32Array:
        """Return the relative radiance ``(rows, columns)`` without optics and noise.

        Sunlit plain: about 0.7.
        """
        hits, directions, origin = self._cast(T_site_camera)
        t = hits["t_hit"].numpy()
        geometry = hits["geometry_ids"].numpy()
        radiance = np.full(t.shape, np.float32(self._appearance.sky))
        hit = np.flatnonzero(np.isfinite(t))  # pixels that show the ground or a rock
        at = origin + t[hit, None] * directions[hit]
        range_m = t[hit] * self._ray_length[hit]
        normals = hits["primitive_normals"].numpy()[hit]
        cosine = np.abs(np.einsum("ij,ij->i", normals, directions[hit])) / self._ray_length[hit]
        footprint = t[hit] / np.float32(self._model.focal_px) / np.sqrt(np.maximum(cosine, np.float32(0.06)))
        light = self._light(hits, hit, geometry[hit], at, footprint)
        haze = np.exp(-range_m / np.float32(self._appearance.haze_distance_m))
        radiance[hit] = light * haze + np.float32(self._appearance.sky) * (1 - haze)
        return np.asarray(radiance.reshape(self._model.rows, self._model.columns), dtype=np.float32)

    def _cast(self, T_site_camera: FloatArray) -> tuple[Any, Float32Array, Float32Array]:
        import open3d as o3d

        rays = np.empty((len(self._rays), 6), dtype=np.float32)
        rays[:, :3] = T_site_camera[:3, 3]
        # Sums instead of a matrix product, for which BLAS would start threads in each worker process.
        x, y = self._rays[:, 0], self._rays[:, 1]
        for axis, (rx, ry, rz) in enumerate(T_site_camera[:3, :3]):
            rays[:, 3 + axis] = rx * x + ry * y + rz
        hits = self._scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
        return hits, rays[:, 3:], T_site_camera[:3, 3].astype(np.float32)

    def _light(
        self,
        hits: Any,
        hit: NDArray[np.intp],
        geometry: NDArray[np.uint32],
        at: Float32Array,
        footprint: Float32Array,
    ) -> Float32Array:
        """Return the radiance of the visible points ``at``, which pixels ``hit`` show, without haze."""
        appearance = self._appearance
        half_width_m = -appearance.ground.origin_m
        baked = (geometry == 0) & (np.abs(at[:, :2]).max(axis=1) < half_width_m)
        light = np.empty(len(hit), dtype=np.float32)
        light[baked] = sample(appearance.ground, at[baked, 0].copy(), at[baked, 1].copy(), footprint[baked])
        on_mesh = np.flatnonzero(~baked)  # points whose radiance is interpolated between mesh vertices
        uv = hits["primitive_uvs"].numpy()[hit[on_mesh]]
        primitive = hits["primitive_ids"].numpy()[hit[on_mesh]]
        on_rock = geometry[on_mesh] == 1
        corners = np.empty((len(on_mesh), 3), dtype=np.int64)
        corners[~on_rock] = self._triangles[0][primitive[~on_rock]]
        if len(self._triangles) > 1:
            corners[on_rock] = self._triangles[1][primitive[on_rock]].astype(np.int64) + self._rock_start
        value = appearance.vertex_radiance[corners]
        light[on_mesh] = value[:, 0] * (1 - uv.sum(axis=1)) + value[:, 1] * uv[:, 0] + value[:, 2] * uv[:, 1]
        # The detail texture is projected vertically; adding height to x and y avoids streaks on steep rock
        # faces.
        x = at[:, 0] + np.float32(0.71) * at[:, 2]
        y = at[:, 1] + np.float32(0.59) * at[:, 2]
        return np.asarray(light * appearance.detail_factor(x, y, footprint), dtype=np.float32)

    def _expose(self, radiance: Float32Array, exposure: float, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Return the image of a radiance: blur, vignetting, noise and quantisation."""
        m = self._model
        blurred = gaussian_filter(radiance, m.psf_sigma_px, mode="nearest", truncate=3.0)
        signal = blurred * self._vignette * np.float32(m.gain_dn * exposure)
        sigma = np.sqrt(m.read_noise_dn**2 + m.shot_noise_dn2_per_dn * np.maximum(signal, 0.0))
        noisy = signal + sigma * rng.standard_normal(signal.shape, dtype=np.float32)
        image: NDArray[np.uint8] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        return image
