# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generalised ICP by small_gicp."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.registration_3d._interface import (
    Registration3DInputs,
    Registration3DInterface,
    Registration3DOutputs,
)


class GicpConfig(DfnConfig):
    """Gate and stopping rule."""

    max_distance_m: float | None = Field(None, gt=0.0, description="Gate of pairs, metres; absent: from the clouds")
    first_medians: float = Field(3.0, ge=1.0, le=20.0, description="Gate in median distances at the guess")
    gate_spacings: float = Field(5.0, ge=1.0, le=50.0, description="Smallest gate in median spacings of the target")
    thin_to: int | None = Field(25_000, ge=100, description="Points left of bigger clouds given without normals")
    max_iterations: int = Field(50, ge=1, le=1000, description="Iterations at most")
    tolerance_m: float | None = Field(None, gt=0.0, description="Step that has converged, metres; absent: spacing/1000")
    neighbours: int = Field(12, ge=5, le=200, description="Neighbourhood of a covariance")


class Gicp(Registration3DInterface):
    """Distances between local planes of both clouds, weighted by their covariances, Gauss-Newton on one thread.

    Notes
    -----
    Segal, Haehnel, Thrun (2009), "Generalized-ICP", doi:10.15607/RSS.2009.V.021; implementation Koide (2024),
    "small_gicp", doi:10.21105/joss.06948.
    """

    Config: ClassVar[type[DfnConfig]] = GicpConfig

    def process(self, inputs: Registration3DInputs) -> Registration3DOutputs:
        """Return T_target_source; raises InputError, or DegenerateGeometryError when too few pairs are left."""
        import small_gicp

        from cdff_common.geometry.kdtree import kd_tree, nearest, spacing
        from cdff_core.dfns.registration_3d import _kernels as k
        from cdff_core.dfns.registration_3d import _surface as s

        cfg: Any = self.config
        source = checked_points(inputs.source, "source", max(s.LEAST_PAIRS, cfg.neighbours))
        target = checked_points(inputs.target, "target", max(s.LEAST_PAIRS, cfg.neighbours))
        T_guess = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
        if inputs.target_normals is None:
            # Rings around the sensor meet themselves at the identity: uneven clouds are thinned first.
            source, target = s.evened(source, target, cfg.thin_to)
        tree = kd_tree(target)
        distance_m, _ = nearest(tree, se3.transform_points(T_guess, source))
        step_m = spacing(tree)
        gate_m = cfg.max_distance_m or max(cfg.gate_spacings * step_m, cfg.first_medians * float(np.median(distance_m)))
        tolerance_m = cfg.tolerance_m or 1e-3 * step_m
        # small_gicp keeps absolute coordinates in its Hessian: rotations far from the origin lose digits, so both
        # clouds are taken about the target's centre.
        centre = target.mean(axis=0)
        clouds = [small_gicp.PointCloud(target - centre), small_gicp.PointCloud(source - _preimage(T_guess, centre))]
        trees = [small_gicp.KdTree(cloud, 1) for cloud in clouds]
        for cloud, its_tree in zip(clouds, trees, strict=True):
            small_gicp.estimate_covariances(cloud, its_tree, cfg.neighbours, 1)
        start = se3.transform(T_guess[:3, :3], np.zeros(3))
        found = small_gicp.align(
            clouds[0],
            clouds[1],
            trees[0],
            start,
            registration_type="GICP",
            max_correspondence_distance=gate_m,
            num_threads=1,
            max_iterations=cfg.max_iterations,
            translation_epsilon=tolerance_m,
            rotation_epsilon=tolerance_m / max(float(np.sqrt(np.mean(np.sum((target - centre) ** 2, axis=1)))), 1e-9),
        )
        if found.num_inliers < s.LEAST_PAIRS:
            raise s.too_few(int(found.num_inliers), len(source), gate_m)
        T = np.array(found.T_target_source)
        T[:3, :3] = se3.normalise_rotation(T[:3, :3])
        T = se3.transform(T[:3, :3], T[:3, 3] + centre - T[:3, :3] @ _preimage(T_guess, centre))
        moved = np.empty_like(source)
        row = np.full(len(source), -1)
        k.pair(tree, source, T, gate_m, row, moved)
        normals = s.tree_normals(tree, cfg.neighbours, inputs.target_normals)
        residual_m = k.plane_distances(tree.points, normals, row, moved)
        return Registration3DOutputs(
            transform=T,
            residual_scale_m=np.array(1.4826 * np.median(np.abs(residual_m))),
            iterations=np.array(int(found.iterations)),
            converged=np.array(bool(found.converged)),
        )


def _preimage(T_target_source: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the point of the source frame that the guess maps onto ``point``."""
    return np.asarray(T_target_source[:3, :3].T @ (point - T_target_source[:3, 3]))
