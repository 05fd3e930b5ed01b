# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ray casting of one body in its own axes, and the light that its surface reflects.

The rays are transformed instead of the mesh, so that the tree of triangles is built once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.environment import earth_light
from cdff_dev.simulate.orbit.materials import Float32Array, MaterialTable, reflected, tilted
from cdff_dev.simulate.orbit.meshes import BodyMesh

#: Distance from the surface at which rays to light sources start, relative to the radius of the body.
_LIFT = 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Visible points of a body.

    Attributes
    ----------
    ray : ndarray intp (k,)
        Indices of the rays that hit, ascending.
    distance_m : ndarray float32 (k,)
        From the start of the ray; directions are unit vectors.
    points_m, normals : ndarray float32 (k, 3)
        Body axes; normals of the triangles on the side of the eye.
    to_eye : ndarray float32 (k, 3)
        Unit vectors, body axes.
    material : ndarray intp (k,)
    """

    ray: NDArray[np.intp]
    distance_m: Float32Array
    points_m: Float32Array
    normals: Float32Array
    to_eye: Float32Array
    material: NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class BodyLight:
    """Light on one body.

    Attributes
    ----------
    to_sun : ndarray float32 (3,)
        Body axes.
    irradiance : float
        Of the visible part of the Sun, relative to the full Sun at 1 au.
    earth : tuple or None
        R_inertial_body (3, 3), position relative to the Earth (3,), direction of the Sun (3,), inertial axes,
        irradiance of the Sun at the Earth, and albedo; None without light from the Earth.
    """

    to_sun: Float32Array
    irradiance: float
    earth: tuple[FloatArray, FloatArray, FloatArray, float, float] | None


class BodyScene:
    """Mesh of a body, prepared for ray casting."""

    def __init__(self, mesh: BodyMesh) -> None:
        import open3d as o3d

        self._tensor = o3d.core.Tensor.from_numpy
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        vertices = np.ascontiguousarray(mesh.vertices_m, dtype=np.float32)
        self._scene.add_triangles(self._tensor(vertices), self._tensor(mesh.triangles.astype(np.uint32)))
        self.table = MaterialTable.of(mesh.materials)
        self._material = mesh.material
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        self.centre_m: FloatArray = 0.5 * (low + high)
        self.radius_m = float(np.linalg.norm(mesh.vertices_m - self.centre_m, axis=1).max())
        self.extents_m: FloatArray = high - low

    def cast(self, origins_m: FloatArray, directions: Float32Array) -> Hits:
        """Return the visible points of rays from (n, 3) or (3,) along unit vectors (n, 3), body axes."""
        # Starting close to the body keeps the precision of distant views.
        toward = self.centre_m - origins_m
        skipped = np.maximum(np.linalg.norm(toward, axis=-1) - 2.0 * self.radius_m, 0.0)
        rays = np.empty((len(directions), 6), dtype=np.float32)
        rays[:, 3:] = directions
        if not np.any(skipped):
            rays[:, :3] = origins_m
        else:
            advance = np.broadcast_to(skipped, len(directions))[:, None]
            rays[:, :3] = np.asarray(origins_m) + advance * directions.astype(np.float64)
        cast = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        from_start = cast["t_hit"].numpy()
        ray = np.flatnonzero(from_start != np.inf)
        normals = cast["primitive_normals"].numpy()[ray]
        to_eye = -directions[ray]
        away = np.einsum("ni,ni->n", normals, to_eye) < 0.0
        normals[away] *= -1.0
        return Hits(
            ray,
            (from_start[ray] + np.broadcast_to(skipped, len(directions))[ray]).astype(np.float32),
            rays[ray, :3] + from_start[ray, None] * directions[ray],
            normals,
            to_eye,
            self._material[cast["primitive_ids"].numpy()[ray]],
        )

    def is_hidden(self, points_m: Float32Array, direction: Float32Array) -> NDArray[np.bool_]:
        """Return whether this body hides points (n, 3) from a light in a direction (3,), body axes."""
        rays = np.empty((len(points_m), 6), dtype=np.float32)
        rays[:, :3], rays[:, 3:] = points_m, direction
        return np.asarray(self._scene.test_occlusions(self._tensor(rays), nthreads=1).numpy())

    def radiance(
        self, hits: Hits, light: BodyLight, others: tuple[tuple[BodyScene, FloatArray], ...] = ()
    ) -> Float32Array:
        """Return the radiance (k,), 1/sr, of the visible points.

        Parameters
        ----------
        others : tuple of (BodyScene, ndarray (4, 4))
            Bodies that may cast shadows on this one, with ``T_other_this``.
        """
        result = np.zeros(len(hits.ray), dtype=np.float32)
        normals = tilted(self.table, hits.material, hits.points_m, hits.normals)
        lit = np.flatnonzero(hits.normals @ light.to_sun > 0.0) if light.irradiance > 0.0 else hits.ray[:0]
        if len(lit):
            start = hits.points_m[lit] + np.float32(_LIFT * self.radius_m) * hits.normals[lit]
            free = ~self.is_hidden(start, light.to_sun)
            for other, T in others:
                if free.any() and _may_shade(other, T, self, light.to_sun):
                    moved = (start @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
                    free &= ~other.is_hidden(moved, (T[:3, :3] @ light.to_sun).astype(np.float32))
            lit = lit[free]
            result[lit] = np.float32(light.irradiance) * reflected(
                self.table,
                hits.material[lit],
                hits.points_m[lit],
                normals[lit],
                light.to_sun,
                hits.to_eye[lit],
            )
        if light.earth is not None:
            R_inertial_body, position_m, to_sun, irradiance, albedo = light.earth
            glow = earth_light(normals @ R_inertial_body.T, position_m, to_sun, albedo)
            white = self.table.albedo + self.table.specular * (1.0 - self.table.albedo)
            result += (irradiance / np.pi * white[hits.material] * glow).astype(np.float32)
        return result


def _may_shade(other: BodyScene, T_other_this: FloatArray, this: BodyScene, to_sun: Float32Array) -> bool:
    """Return whether the shadow of the bounding sphere of one body can reach that of another."""
    offset = other.centre_m - (T_other_this[:3, :3] @ this.centre_m + T_other_this[:3, 3])
    sun = T_other_this[:3, :3] @ to_sun
    along = float(offset @ sun)
    reach = this.radius_m + other.radius_m
    return along > -reach and float(np.linalg.norm(offset - along * sun)) < reach
