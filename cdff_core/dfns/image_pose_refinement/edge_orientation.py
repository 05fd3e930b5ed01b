# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correlation of edge orientations around a predicted pose: search by CMA-ES, then mean and covariance."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry.covariance import symmetrised
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_pose_refinement.interface import Inputs, Interface, Outputs
from cdff_core.object_models.evolution import minimise
from cdff_core.object_models.image_fields import (
    ImageField,
    body_field,
    edge_correlation,
    edge_energy,
    seam_mask,
    window_field,
)
from cdff_core.object_models.importance import mean_and_covariance
from cdff_core.object_models.pose_change import PoseChange
from cdff_core.object_models.rendering import Window

#: Standard deviations of the search at its start, and variance of the first samples, relative to the
#: prediction.
_DEVIATION, _SAMPLED_VARIANCE = 0.8, 0.16
#: Margin of the window around the body: diameters of the body and standard deviations of its position.
_MARGIN, _MARGIN_SIGMAS = 0.15, 4.0
#: Mean of the squared edges in the outline, 0 to 1, below which the image is empty.
_LEAST_EDGES = 1e-4
#: Percentile of the grey levels that counts as the background.
_BACKGROUND_PERCENT = 1.0


class EdgeOrientationConfig(DfnConfig):
    """Parameters of EdgeOrientation."""

    window_px: int = Field(160, ge=32, le=640, description="Side of the rendered window")
    population: int = Field(14, ge=6, le=100, description="Poses of a generation of the search")
    generations: int = Field(20, ge=1, le=200, description="Generations of the search")
    rounds: int = Field(4, ge=1, le=20, description="Rounds of samples of the pose after the search")
    samples: int = Field(40, ge=16, le=1000, description="Samples of a round")
    temperature: float = Field(
        0.02,
        gt=0,
        le=1,
        description="Decrease of the agreement that makes a pose less likely by a factor of e",
    )
    min_correlation: float = Field(
        0.15, ge=-1, le=1, description="Correlation of the edges below which the body is not found: no_edges"
    )
    seed: int = Field(0, ge=0, le=2**31, description="Seed of the search")


class EdgeOrientation(Interface[EdgeOrientationConfig]):
    """Mean of the poses near the prediction, weighted with the agreement of the edges inside the outline.

    The maximum of the agreement is not used: rotations out of the image plane and the range change it little.
    All poses are normalised with the energy of the edges at the prediction.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return mean and covariance of the pose; raises RefusedError or InputError."""
        cfg = self.config
        window, field = _window_field(inputs, cfg.window_px)
        vertices, triangles = np.ascontiguousarray(inputs.vertices), np.ascontiguousarray(inputs.triangles)
        predicted = body_field(vertices, triangles, inputs.pose, window)
        image_energy = edge_energy(field.edges[seam_mask(predicted)])
        if image_energy < _LEAST_EDGES * predicted.mask.sum():
            raise RefusedError("no edges near the body", [f"no_edges:0.00<{cfg.min_correlation:g}"])
        change = PoseChange(inputs.pose, np.zeros(3), inputs.covariance)

        def correlation(T_camera_model: FloatArray) -> float:
            body = body_field(vertices, triangles, T_camera_model, window)
            return edge_correlation(field, body, image_energy)

        def energy(vectors: FloatArray) -> FloatArray:
            prior: FloatArray = 0.5 * np.square(vectors).sum(axis=1)
            return prior - np.array([correlation(T) for T in change.poses(vectors)]) / cfg.temperature

        rng = np.random.default_rng(cfg.seed)
        mean, vectors, energies = minimise(
            energy,
            np.zeros(6),
            _DEVIATION,
            population=cfg.population,
            generations=cfg.generations,
            rng=rng,
        )
        best = int(np.argmin(energies))
        start = vectors[best] if energies[best] < energy(mean[None])[0] else mean
        mean, spread = mean_and_covariance(
            energy, start, _SAMPLED_VARIANCE * np.eye(6), rounds=cfg.rounds, samples=cfg.samples, rng=rng
        )
        T_camera_model = change.poses(mean[None])[0]
        final = body_field(vertices, triangles, T_camera_model, window)
        edges = edge_correlation(field, final, edge_energy(field.edges[seam_mask(final)]))
        if not edges >= cfg.min_correlation:
            raise RefusedError(
                f"edges of image and mesh correlate by {edges:.2f}",
                [f"no_edges:{edges:.2f}<{cfg.min_correlation:g}"],
            )
        return Outputs(
            pose=T_camera_model,
            covariance=symmetrised(change.covariance(spread)),
            correlation=edges,
        )


def _window_field(inputs: Inputs, side_px: int) -> tuple[Window, ImageField]:
    """Return a square window around the predicted body, and the fields of the image in it."""
    K = inputs.camera_matrix
    if K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
        raise InputError(f"focal lengths {K[0, 0]:g}, {K[1, 1]:g} px: expected positive ones")
    centre = inputs.pose[:3, :3] @ inputs.centre_m + inputs.pose[:3, 3]
    if centre[2] <= inputs.diameter_m / 2.0:
        raise RefusedError("the body is behind the camera", ["behind_camera"])
    centre_px = (K @ (centre / centre[2]))[:2]
    across_m = math.sqrt(max(float(np.diag(inputs.covariance)[:2].max()), 0.0))
    extent_m = (1.0 + _MARGIN) * inputs.diameter_m + _MARGIN_SIGMAS * across_m
    extent_px = K[0, 0] * extent_m / float(centre[2])
    height, width = inputs.image.shape
    if not (
        np.abs(centre_px - [0.5 * width, 0.5 * height]) < 0.5 * (extent_px + np.array([width, height]))
    ).all():
        raise RefusedError("the body is outside the image", ["outside_image"])
    grey = inputs.image.astype(np.float32)
    signal = np.maximum(grey - np.percentile(grey, _BACKGROUND_PERCENT), 0.0)
    camera = Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], height, width)
    return window_field(signal, camera, centre_px, extent_px, side_px)
