# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated stereo camera: one ray per pixel, texture lookups, optics and sensor noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import FramePair
from cdff_dev.simulate.scenario import Navcam
from cdff_dev.simulate.surface import Appearance, Float32Array, sample, sunlit
from cdff_dev.simulate.world import World


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The pixels of one camera, row by row, without optics and noise.

    Attributes
    ----------
    radiance : NDArray[np.float32], shape (n,)
        Relative; sunlit plain: about 0.7.
    depth_m : NDArray[np.float32], shape (n,)
        Depth along the optical axis; infinite for the sky.
    origin_m : NDArray[np.float32], shape (3,) or (n, 3)
        Position of the camera in site, for each pixel if the rows are exposed at different times.
    directions : NDArray[np.float32], shape (n, 3)
        In site; one metre of depth long.
    normals : NDArray[np.float32], shape (n, 3)
        Normals in site of the visible surface.
    """

    radiance: Float32Array
    depth_m: Float32Array
    origin_m: Float32Array
    directions: Float32Array
    normals: Float32Array


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
        self._rays = pixel_rays(model, K)
        corner_off_axis = (K[0, 2] ** 2 + K[1, 2] ** 2) / K[0, 0] ** 2
        off_axis = ((self._rays[:, :2] ** 2).sum(1) / corner_off_axis).reshape(model.rows, model.columns)
        self._vignette = (1.0 - model.vignetting * off_axis).astype(np.float32)

    @property
    def model(self) -> Navcam:
        """Model of the camera."""
        return self._model

    @property
    def rays(self) -> FloatArray:
        """Directions of the pixels in the camera frame, shape (rows * columns, 3)."""
        return self._rays

    @property
    def sky(self) -> float:
        """Radiance of the sky."""
        return self._appearance.sky

    def sunlit(self, points_m: Float32Array, sun: FloatArray) -> NDArray[np.bool_]:
        """Return whether no terrain or rock hides the sun from points ``(n, 3)`` in site."""
        return sunlit(self._scene, points_m + np.float32(0.02) * sun.astype(np.float32), sun) > 0.0

    def exposures(self, rng: np.random.Generator) -> FloatArray:
        """Return the relative exposures of left and right image of a pair."""
        model = self._model
        exposure = 1.0 + model.exposure_sigma * rng.standard_normal()
        return np.asarray(exposure * (1.0 + model.balance_sigma * rng.standard_normal(2)))

    def pair(
        self, T_site_base: FloatArray, rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return left and right image ``(rows, columns)`` of a rover at the pose ``T_site_base``."""
        model = self._model
        exposures = self.exposures(rng)
        left = self.expose(self.radiance(T_site_base @ model.T_base_left), exposures[0], rng)
        right = self.expose(self.radiance(T_site_base @ model.T_base_right), exposures[1], rng)
        return left, right

    def depth(self, T_site_camera: FloatArray) -> Float32Array:
        """Return the depth along the optical axis ``(rows, columns)``, metres; infinite for the sky."""
        hit: Float32Array = self._cast(T_site_camera, self._rays)[0]["t_hit"].numpy()
        return hit.reshape(self._model.rows, self._model.columns)

    def radiance(self, T_site_camera: FloatArray) -> Float32Array:
        """Return the relative radiance ``(rows, columns)`` without optics and noise.

        Sunlit plain: about 0.7.
        """
        view = self.view(T_site_camera, self._rays)
        return view.radiance.reshape(self._model.rows, self._model.columns)

    def view(self, T_site_camera: FloatArray, rays: FloatArray) -> View:
        """Return the pixels of a camera.

        Parameters
        ----------
        T_site_camera : NDArray[np.float64], shape (4, 4) or (rows, 4, 4)
            Pose of the camera, for each row if the rows are exposed at different times.
        rays : NDArray[np.float64], shape (n, 3)
            Directions of the pixels in the camera frame, one metre of depth long.
        """
        hits, directions, origin = self._cast(T_site_camera, rays)
        t = hits["t_hit"].numpy()
        geometry = hits["geometry_ids"].numpy()
        radiance = np.full(t.shape, np.float32(self._appearance.sky))
        hit = np.flatnonzero(np.isfinite(t))  # pixels that show the ground or a rock
        at = (origin if origin.ndim == 1 else origin[hit]) + t[hit, None] * directions[hit]
        ray_length = np.linalg.norm(rays, axis=1).astype(np.float32)
        range_m = t[hit] * ray_length[hit]
        all_normals = hits["primitive_normals"].numpy()
        normals = all_normals[hit]
        cosine = np.abs(np.einsum("ij,ij->i", normals, directions[hit])) / ray_length[hit]
        footprint = t[hit] / np.float32(self._model.focal_px) / np.sqrt(np.maximum(cosine, np.float32(0.06)))
        light = self._light(hits, hit, geometry[hit], at, footprint)
        haze = np.exp(-range_m / np.float32(self._appearance.haze_distance_m))
        radiance[hit] = light * haze + np.float32(self._appearance.sky) * (1 - haze)
        return View(np.asarray(radiance, dtype=np.float32), t, origin, directions, all_normals)

    def _cast(self, T_site_camera: FloatArray, ray: FloatArray) -> tuple[Any, Float32Array, Float32Array]:
        """Return the hits of rays, their distances and directions in the site frame."""
        import open3d as o3d

        if T_site_camera.ndim == 3:
            T_site_camera = np.repeat(T_site_camera, self._model.columns, axis=0)
        rays = np.empty((len(ray), 6), dtype=np.float32)
        rays[:, :3] = T_site_camera[..., :3, 3]
        # Sums instead of a matrix product, for which BLAS would start threads in each worker process.
        x, y = ray[:, 0], ray[:, 1]
        for axis in range(3):
            rx, ry, rz = (T_site_camera[..., axis, k] for k in range(3))
            rays[:, 3 + axis] = rx * x + ry * y + rz
        hits = self._scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
        return hits, rays[:, 3:], T_site_camera[..., :3, 3].astype(np.float32)

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

    def expose(self, radiance: Float32Array, exposure: float, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Return the image of a radiance: blur, vignetting, noise and quantisation."""
        model = self._model
        blurred = gaussian_filter(radiance, model.psf_sigma_px, mode="nearest", truncate=3.0)
        signal = blurred * self._vignette * np.float32(model.gain_dn * exposure)
        sigma = np.sqrt(model.read_noise_dn**2 + model.shot_noise_dn2_per_dn * np.maximum(signal, 0.0))
        noisy = signal + sigma * rng.standard_normal(signal.shape, dtype=np.float32)
        image: NDArray[np.uint8] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        return image


def camera_of_world(world: World, scene: Any) -> StereoCamera | None:
    """Return the stereo camera of a world; None if its scenario has none.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Geometry of the world, see ``cast_scene``.
    """
    model = world.scenario.navcam
    if model is None or world.appearance is None:
        return None
    vertices, triangles = world.relief.mesh()
    meshes = (triangles, world.rocks.triangles) if len(world.rocks.triangles) else (triangles,)
    return StereoCamera(model, scene, world.appearance, len(vertices), meshes)


def pair_of_images(
    model: Navcam, images: tuple[NDArray[np.uint8], NDArray[np.uint8]], stamp_ns: int, frame: str
) -> FramePair:
    """Return the message of left and right image ``(rows, columns)`` of a camera."""
    return FramePair.from_images(
        *images,
        baseline_m=model.baseline_m,
        camera_matrix=model.camera_matrix,
        stamp_ns=stamp_ns,
        sensor=frame,
    )


def pixel_rays(model: Navcam, K: FloatArray, k1: float = 0.0) -> FloatArray:
    """Return directions ``(rows * columns, 3)`` of the pixels of a camera with intrinsics K, depth 1.

    ``k1`` is the coefficient of radial distortion, from image to direction.
    """
    v, u = np.mgrid[0 : model.rows, 0 : model.columns]
    rays = np.stack(
        [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u, dtype=float)], axis=-1
    ).reshape(-1, 3)
    if k1:
        rays[:, :2] *= 1.0 + k1 * (rays[:, :2] ** 2).sum(axis=1, keepdims=True)
    return np.asarray(rays)
