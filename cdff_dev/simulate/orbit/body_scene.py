# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ray casting of one body in its own axes, and the light that its surface reflects.

The rays are transformed instead of the mesh, so that the tree of triangles is built once.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit._ray_kernels import place_rays, visible_points
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
        Indices of the cast rays that hit, ascending.
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
        self._material = np.ascontiguousarray(mesh.material, dtype=np.intp)
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        self.centre_m: FloatArray = 0.5 * (low + high)
        self.radius_m = float(np.linalg.norm(mesh.vertices_m - self.centre_m, axis=1).max())
        #: Corners of the bounding box, (8, 3).
        self.corners_m: FloatArray = np.array(list(itertools.product(*zip(low, high, strict=True))))

    def cast(
        self,
        directions: Float32Array,
        T_body_sensor: FloatArray,
        chosen: NDArray[np.intp] | None = None,
        of_pose: NDArray[np.intp] | None = None,
    ) -> Hits:
        """Return the visible points of rays from a sensor.

        Parameters
        ----------
        directions : ndarray float32 (n, 3)
            Unit vectors, sensor axes.
        T_body_sensor : ndarray (p, 4, 4)
        chosen : ndarray intp (k,), optional
            Rays to cast, ascending; the indices of the result refer to them. Default: all.
        of_pose : ndarray intp (n,), optional
            Pose of each ray; default: the first.
        """
        if chosen is None:
            chosen = np.arange(len(directions))
        if of_pose is None:
            of_pose = np.zeros(len(directions), dtype=np.intp)
        origins = np.ascontiguousarray(T_body_sensor[:, :3, 3])
        # Starting close to the body keeps the precision of distant views.
        skipped = np.maximum(np.linalg.norm(self.centre_m - origins, axis=1) - 2.0 * self.radius_m, 0.0)
        R = np.ascontiguousarray(T_body_sensor[:, :3, :3])
        rays = place_rays(directions, chosen, of_pose, R, origins, skipped)
        cast = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        index, distance_m, points_m, normals, to_eye, material = visible_points(
            rays,
            cast["t_hit"].numpy(),
            cast["primitive_ids"].numpy(),
            cast["primitive_normals"].numpy(),
            self._material,
        )
        distance_m += skipped[of_pose[chosen[index]]].astype(np.float32)
        return Hits(index, distance_m, points_m, normals, to_eye, material)

    def clearances_m(self, points_m: FloatArray) -> FloatArray:
        """Return the distances (n,) of points (n, 3), body axes, from the surface; 0 inside the body.

        A point is inside if the surfaces that it sees along and against each axis all face away from it.
        """
        points = np.ascontiguousarray(points_m, dtype=np.float32)
        distances = self._scene.compute_distance(self._tensor(points), nthreads=1).numpy().astype(float)
        enclosed = np.ones(len(points), dtype=bool)
        for direction in np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32):
            rays = np.hstack([points, np.broadcast_to(direction, points.shape)])
            cast = self._scene.cast_rays(self._tensor(np.ascontiguousarray(rays)), nthreads=1)
            faces_away = cast["primitive_normals"].numpy() @ direction > 0.0
            enclosed &= faces_away & np.isfinite(cast["t_hit"].numpy())
        return np.where(enclosed, 0.0, distances)

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
            is_lit = ~self.is_hidden(start, light.to_sun)
            for other, T in others:
                if is_lit.any() and _may_shade(other, T, self, light.to_sun):
                    start_in_scene = (start @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
                    is_lit &= ~other.is_hidden(start_in_scene, (T[:3, :3] @ light.to_sun).astype(np.float32))
            lit = lit[is_lit]
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
