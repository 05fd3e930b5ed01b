# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generalised ICP with the library small_gicp."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, nearest, spacing
from cdff_common.geometry.robust import median_sigma
from cdff_core.dfns.registration_3d import _kernels, _surface
from cdff_core.dfns.registration_3d.interface import Inputs, Interface, Outputs


class GicpConfig(_surface.RegistrationConfig):
    """Parameters of Gicp."""

    gate_spacings: float = Field(5.0, ge=1, le=50, description="Minimum gate in point spacings of the target")
    max_iterations: int = Field(50, ge=1, le=1000, description="Maximum number of iterations")
    neighbours: int = Field(
        12, ge=5, le=200, description="Number of points of a neighbourhood for covariances"
    )


class Gicp(Interface[GicpConfig]):
    """Minimise the distances between the local planes of both clouds, weighted by their covariances.

    Gauss-Newton iterations on one thread.

    Notes
    -----
    Segal, Haehnel, Thrun (2009), "Generalized-ICP", doi:10.15607/RSS.2009.V.021; implementation Koide (2024),
    "small_gicp", doi:10.21105/joss.06948.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return T_target_source; raises InputError, or DegenerateGeometryError when too few pairs remain."""
        import small_gicp

        cfg = self.config
        source, target, T_guess = _surface.prepare_clouds(inputs, cfg, cfg.neighbours, cfg.neighbours)
        tree = kd_tree(target)
        distance_m, _ = nearest(tree, se3.transform_points(T_guess, source))
        spacing_m = spacing(tree)
        gate_m = cfg.max_distance_m or max(
            cfg.gate_spacings * spacing_m, _surface.INITIAL_GATE_MEDIANS * float(np.median(distance_m))
        )
        tolerance_m = cfg.tolerance_m or 1e-3 * spacing_m
        # small_gicp computes the Hessian of the rotation about the origin of the coordinates. Far from the origin
        # it loses digits; both clouds are therefore shifted to the centre of the target.
        centre = target.mean(axis=0)
        clouds = [
            small_gicp.PointCloud(target - centre),
            small_gicp.PointCloud(source - _preimage(T_guess, centre)),
        ]
        trees = [small_gicp.KdTree(cloud, 1) for cloud in clouds]
        for cloud, cloud_tree in zip(clouds, trees, strict=True):
            small_gicp.estimate_covariances(cloud, cloud_tree, cfg.neighbours, 1)
        T_centred = se3.transform(T_guess[:3, :3], np.zeros(3))
        result = small_gicp.align(
            clouds[0],
            clouds[1],
            trees[0],
            T_centred,
            registration_type="GICP",
            max_correspondence_distance=gate_m,
            num_threads=1,
            max_iterations=cfg.max_iterations,
            translation_epsilon=tolerance_m,
            rotation_epsilon=tolerance_m
            / max(float(np.sqrt(np.mean(np.sum((target - centre) ** 2, axis=1)))), 1e-9),
        )
        if result.num_inliers < _surface.MIN_PAIRS:
            raise _surface.too_few_pairs_error(int(result.num_inliers), len(source), gate_m)
        T = np.array(result.T_target_source)
        T[:3, :3] = se3.normalise_rotation(T[:3, :3])
        T = se3.transform(T[:3, :3], T[:3, 3] + centre - T[:3, :3] @ _preimage(T_guess, centre))
        pairs = _kernels.no_pairs(len(source))
        _kernels.pair(tree, source, T, gate_m, pairs)
        normals = _surface.tree_normals(tree, cfg.neighbours, inputs.target_normals)
        residual_m = _kernels.plane_distances(tree.points, normals, pairs.row, pairs.moved)
        return Outputs(
            transform=T,
            residual_scale_m=median_sigma(residual_m),
            iterations=int(result.iterations),
            converged=bool(result.converged),
        )


def _preimage(T_target_source: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the point of the source frame that the guess maps onto ``point``."""
    return np.asarray(T_target_source[:3, :3].T @ (point - T_target_source[:3, 3]))
