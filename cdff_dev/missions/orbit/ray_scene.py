# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A triangle surface for ray casting and distances, with numpy arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray


class RaySurface:
    """Surface of triangles.

    Parameters
    ----------
    vertices : ndarray (n, 3)
    triangles : ndarray (m, 3)
    """

    def __init__(self, vertices: NDArray[Any], triangles: NDArray[Any]) -> None:
        import open3d as o3d

        self._tensor: Any = o3d.core.Tensor.from_numpy
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(vertices, np.float32)),
            self._tensor(np.ascontiguousarray(triangles, np.uint32)),
        )

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the distances (k,) of points (k, 3) from the surface."""
        queries = self._tensor(np.ascontiguousarray(points, np.float32))
        return np.asarray(self._scene.compute_distance(queries).numpy(), dtype=float)

    def cast(
        self, origins: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
        """Return the first hits of rays (…, 3).

        Returns
        -------
        parameters : ndarray (…)
            Of the hits along the rays, in lengths of the direction; infinite without one.
        triangles : ndarray (…)
            Rows of the hit triangles; 0 without a hit.
        normals : ndarray (…, 3)
        """
        rays = np.concatenate([origins, np.broadcast_to(directions, origins.shape)], axis=-1)
        hits = self._scene.cast_rays(self._tensor(rays.astype(np.float32)))
        parameters = np.asarray(hits["t_hit"].numpy(), dtype=float)
        triangles = np.where(np.isfinite(parameters), hits["primitive_ids"].numpy(), 0).astype(np.intp)
        return parameters, triangles, np.asarray(hits["primitive_normals"].numpy(), dtype=float)
