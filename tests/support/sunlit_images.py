# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of bodies in the light of the Sun by tracing rays with Open3D, independent of ``lit_body``."""

from __future__ import annotations

import numpy as np

from tests.support import satellite

#: Rays along each side of a pixel, and standard deviation of the image of a point, px.
_RAYS, _SPREAD_PX = 3, 0.7


def sunlit(mesh: satellite.Mesh, T: np.ndarray, K: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Return the radiance (240, 320) of a body at T_camera_body, with Lommel-Seeliger reflection.

    Parameters
    ----------
    K : ndarray, shape (3, 3)
        Camera matrix, px.
    sun : ndarray, shape (3,)
        Unit vector to the Sun in the frame of the camera.
    """
    import open3d
    from scipy.ndimage import gaussian_filter

    vertices = mesh[0] @ T[:3, :3].T + T[:3, 3]
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), mesh[1].astype(np.uint32))
    v, u = (np.mgrid[: 240 * _RAYS, : 320 * _RAYS] + 0.5) / _RAYS - 0.5
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    hits = scene.cast_rays(np.concatenate([np.zeros_like(rays), rays], axis=-1).astype(np.float32))
    distance = hits["t_hit"].numpy()
    is_hit = np.isfinite(distance)
    normals = hits["primitive_normals"].numpy()[is_hit].astype(np.float64)
    normals *= -np.sign(np.sum(normals * rays[is_hit], axis=1, keepdims=True))
    points = rays[is_hit] * distance[is_hit, None] + 1e-4 * normals
    to_sun = np.concatenate([points, np.broadcast_to(sun, points.shape)], axis=1)
    is_shadowed = np.isfinite(scene.cast_rays(to_sun.astype(np.float32))["t_hit"].numpy())
    mu0, mu = np.maximum(normals @ sun, 0.0), -np.sum(normals * rays[is_hit], axis=1)
    radiance = np.zeros(is_hit.shape)
    radiance[is_hit] = np.where(is_shadowed, 0.0, 2.0 * mu0 / np.maximum(mu0 + mu, 1e-6))
    return np.asarray(gaussian_filter(radiance.reshape(240, _RAYS, 320, _RAYS).mean(axis=(1, 3)), _SPREAD_PX))
