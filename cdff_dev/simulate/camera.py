# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The stereo camera: one ray a pixel, texture lookups, optics and sensor noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.scenario import Navcam
from cdff_dev.simulate.surface import Float32Array, Look, sample


class StereoCamera:
    """Renders pairs of one scenario's navcam; holds the rays of the camera frame.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Geometry 0 is the ground, 1 the rocks.
    ground_vertices : int
        Number of vertices of geometry 0: where the rocks' radiances start.
    triangles : tuple of NDArray[np.uint32]
        Vertex indices of the triangles of ground and rocks, (m, 3) each.
    """

    def __init__(
        self,
        model: Navcam,
        scene: Any,
        look: Look,
        ground_vertices: int,
        triangles: tuple[NDArray[np.uint32], ...],
    ) -> None:
        self._model = model
        self._scene = scene
        self._look = look
        self._rock_start = ground_vertices
        self._triangles = triangles
        K = model.camera_matrix
        v, u = np.mgrid[0 : model.rows, 0 : model.columns]
        rays = np.stack(
            [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u, dtype=float)], axis=-1
        )
        self._rays = rays.reshape(-1, 3)
        self._ray_length = np.linalg.norm(self._rays, axis=1).astype(np.float32)
        corner = (K[0, 2] ** 2 + K[1, 2] ** 2) / K[0, 0] ** 2
        off_axis = ((self._rays[:, :2] ** 2).sum(1) / corner).reshape(model.rows, model.columns)
        self._vignette = (1.0 - model.vignetting * off_axis).astype(np.float32)

    def pair(
        self, T_site_base: FloatArray, rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Left and right image ``(rows, columns)`` of a rover standing at ``T_site_base``."""
        m = self._model
        exposure = 1.0 + m.exposure_sigma * rng.standard_normal()
        balance = 1.0 + m.balance_sigma * rng.standard_normal(2)
        left = self._expose(self.radiance(T_site_base @ m.T_base_left), exposure * balance[0], rng)
        right = self._expose(self.radiance(T_site_base @ m.T_base_right), exposure * balance[1], rng)
        return left, right

    def depth(self, T_site_camera: FloatArray) -> Float32Array:
        """Depth along the optical axis ``(rows, columns)``, metres; inf at the sky."""
        hit: Float32Array = self._cast(T_site_camera)[0]["t_hit"].numpy()
        return hit.reshape(self._model.rows, self._model.columns)

    def radiance(self, T_site_camera: FloatArray) -> Float32Array:
        """Relative radiance ``(rows, columns)`` without optics or noise; the sunlit plain is about 0.7."""
        answer, directions, origin = self._cast(T_site_camera)
        t = answer["t_hit"].numpy()
        geometry = answer["geometry_ids"].numpy()
        out = np.full(t.shape, np.float32(self._look.sky))
        seen = np.flatnonzero(np.isfinite(t))
        at = origin + t[seen, None] * directions[seen]
        range_m = t[seen] * self._ray_length[seen]
        normals = answer["primitive_normals"].numpy()[seen]
        cosine = np.abs(np.einsum("ij,ij->i", normals, directions[seen])) / self._ray_length[seen]
        footprint = t[seen] / np.float32(self._model.focal_px) / np.sqrt(np.maximum(cosine, np.float32(0.06)))
        light = self._light(answer, seen, geometry[seen], at, footprint)
        haze = np.exp(-range_m / np.float32(self._look.haze_distance_m))
        out[seen] = light * haze + np.float32(self._look.sky) * (1 - haze)
        return np.asarray(out.reshape(self._model.rows, self._model.columns), dtype=np.float32)

    def _cast(self, T_site_camera: FloatArray) -> tuple[Any, Float32Array, Float32Array]:
        import open3d as o3d

        rays = np.empty((len(self._rays), 6), dtype=np.float32)
        rays[:, :3] = T_site_camera[:3, 3]
        # Sums instead of a matrix product: BLAS would start its threads in each worker.
        x, y = self._rays[:, 0], self._rays[:, 1]
        for axis, (rx, ry, rz) in enumerate(T_site_camera[:3, :3]):
            rays[:, 3 + axis] = rx * x + ry * y + rz
        answer = self._scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
        return answer, rays[:, 3:], T_site_camera[:3, 3].astype(np.float32)

    def _light(
        self,
        answer: Any,
        seen: NDArray[np.intp],
        geometry: NDArray[np.uint32],
        at: Float32Array,
        footprint: Float32Array,
    ) -> Float32Array:
        look = self._look
        half = -look.ground.origin_m
        baked = (geometry == 0) & (np.abs(at[:, :2]).max(axis=1) < half)
        light = np.empty(len(seen), dtype=np.float32)
        light[baked] = sample(look.ground, at[baked, 0].copy(), at[baked, 1].copy(), footprint[baked])
        rest = np.flatnonzero(~baked)
        uv = answer["primitive_uvs"].numpy()[seen[rest]]
        primitive = answer["primitive_ids"].numpy()[seen[rest]]
        on_rock = geometry[rest] == 1
        corners = np.empty((len(rest), 3), dtype=np.int64)
        corners[~on_rock] = self._triangles[0][primitive[~on_rock]]
        if len(self._triangles) > 1:
            corners[on_rock] = self._triangles[1][primitive[on_rock]].astype(np.int64) + self._rock_start
        value = look.vertex_radiance[corners]
        light[rest] = value[:, 0] * (1 - uv.sum(axis=1)) + value[:, 1] * uv[:, 0] + value[:, 2] * uv[:, 1]
        # The detail texture is projected vertically; adding height to x and y avoids streaks on steep rock
        # faces.
        x = at[:, 0] + np.float32(0.71) * at[:, 2]
        y = at[:, 1] + np.float32(0.59) * at[:, 2]
        return np.asarray(light * look.detail_factor(x, y, footprint), dtype=np.float32)

    def _expose(self, radiance: Float32Array, exposure: float, rng: np.random.Generator) -> NDArray[np.uint8]:
        m = self._model
        blurred = gaussian_filter(radiance, m.psf_sigma_px, mode="nearest", truncate=3.0)
        signal = blurred * self._vignette * np.float32(m.gain_dn * exposure)
        sigma = np.sqrt(m.read_noise_dn**2 + m.shot_noise_dn2_per_dn * np.maximum(signal, 0.0))
        noisy = signal + sigma * rng.standard_normal(signal.shape, dtype=np.float32)
        image: NDArray[np.uint8] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        return image
