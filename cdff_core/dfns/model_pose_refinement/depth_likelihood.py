# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ranking and refinement of poses by rendering the model into the scan."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import compose_covariance, rotate_covariance
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.model_pose_refinement.interface import Inputs, Interface, Outputs
from cdff_core.object_models.decimation import decimate_to_cell
from cdff_core.object_models.hypotheses import SurfaceModel
from cdff_core.object_models.nearest_grid import NearestGrid
from cdff_core.object_models.refinement import PoseRefiner
from cdff_core.object_models.scan_view import scan_view

#: Edge of the cells to which the mesh is decimated, in standard deviations of a range: smaller details do not
#: change the likelihood.
_CELL_SIGMAS = 0.3
#: Smallest estimate of the noise, in diameters.
_LEAST_SIGMA = 2e-4


class DepthLikelihoodConfig(DfnConfig):
    """Parameters of DepthLikelihood."""

    refined: int = Field(8, ge=1, le=50, description="Largest number of given poses that are refined")
    model_sigma: float = Field(
        0.002,
        ge=0,
        le=0.1,
        description="Standard deviation of the surface of the model, relative to its diameter",
    )
    seed: int = Field(0, ge=0, le=2**31, description="Seed of the search")


class DepthLikelihood(Interface[DepthLikelihoodConfig]):
    """Likelihood of ranges, overlap and free space, maximised by CMA-ES; see ``refinement``."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return refined poses, best first, with covariances; raises InputError or RefusedError."""
        cfg = self.config
        view = scan_view(inputs.scan, inputs.diameter_m)
        surface = SurfaceModel(
            np.ascontiguousarray(inputs.points, np.float64),
            np.ascontiguousarray(inputs.normals, np.float64),
            NearestGrid(inputs.grid_index, inputs.grid_low, inputs.grid_cell_m),
            inputs.diameter_m,
        )
        sigma_m = float(np.hypot(inputs.sigma_m, cfg.model_sigma * inputs.diameter_m))
        vertices_m, triangles = decimate_to_cell(
            inputs.drawn_vertices, inputs.drawn_triangles, _CELL_SIGMAS * sigma_m
        )
        refiner = PoseRefiner(
            view,
            surface,
            vertices_m,
            triangles,
            inputs.centre_m,
            sigma_m,
            cfg.seed,
        )
        T_view_sensor = se3.transform(view.R_view_sensor, np.zeros(3))
        poses = T_view_sensor @ inputs.poses
        if inputs.sigma_is_upper_bound:
            sigma_m = refiner.estimate_noise(poses, max(cfg.model_sigma, _LEAST_SIGMA) * inputs.diameter_m)
        refined_poses = refiner.ranked(poses, cfg.refined)
        refined_poses[0] = refiner.with_covariance(refined_poses[0])
        T_sensor_view = T_view_sensor.T
        to_origin = se3.transform(np.eye(3), -inputs.centre_m)
        covariances = []
        for refined_pose in refined_poses:
            at_centre = refined_pose.T @ se3.transform(np.eye(3), inputs.centre_m)
            in_view = compose_covariance(at_centre, refined_pose.covariance, to_origin, np.zeros((6, 6)))
            covariances.append(rotate_covariance(in_view, T_sensor_view[:3, :3]))
        return Outputs(
            poses=np.stack([T_sensor_view @ refined_pose.T for refined_pose in refined_poses]),
            covariances=np.stack(covariances),
            costs=np.array([refined_pose.cost for refined_pose in refined_poses]),
            rays=np.stack([refined_pose.rays for refined_pose in refined_poses]),
            sigma_m=sigma_m,
        )
