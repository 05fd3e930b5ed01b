# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SHOT: signatures of histograms of orientations, 352 values."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_description_3d._interface import (
    FeaturesDescription3DInputs,
    FeaturesDescription3DInterface,
    FeaturesDescription3DOutputs,
)
from cdff_core.dfns.features_description_3d._support import Float, SupportConfig, checked_support

_FLATTEST = 1e-6


class ShotConfig(SupportConfig):
    """Size of the support, and whether the sides of the normals are known."""

    signed_normals: bool = Field(True, description="Whether the sides of the normals are known")


class Shot(FeaturesDescription3DInterface):
    """Histograms of the normals' angles to the local z axis in 8 x 2 x 2 volumes of a sphere, 11 bins each.

    Notes
    -----
    Tombari, Salti, Di Stefano (2010), doi:10.1007/978-3-642-15558-1_26; Salti, Tombari, Di Stefano (2014),
    doi:10.1016/j.cviu.2014.04.011. Local frame: eigenvectors of the scatter about the keypoint, weighted by
    ``R - d``; x (greatest) and z (least) are turned to where most neighbours lie, y = z x x. Interpolation is
    quadrilinear, the product of the weights ``1 - d`` of the four dimensions, as the papers define it; PCL adds the
    four weights instead.
    """

    Config: ClassVar[type[DfnConfig]] = ShotConfig

    def setup(self) -> None:
        """Compile the kernels, so that the first call costs what the others do."""
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.5], [1, 1, 0], [0.5, 0, 0]])
        up = np.tile([0.0, 0.0, 1.0], (len(corners), 1))
        self._described(corners, up, corners[:1], 2.0, 3)

    def process(self, inputs: FeaturesDescription3DInputs) -> FeaturesDescription3DOutputs:
        """Return one descriptor per keypoint; raises InputError on malformed clouds."""
        points, normals, keypoints, radius_m = checked_support(inputs, self.config)
        return self._described(points, normals, keypoints, radius_m, self.config.least_neighbours)

    def _described(
        self, points: Float, normals: Float, keypoints: Float, radius_m: float, least: int
    ) -> FeaturesDescription3DOutputs:
        from cdff_common.geometry.neighbours import radius_neighbours
        from cdff_core.dfns.features_description_3d._shot_kernels import histograms, local_frames

        cfg: Any = self.config
        start, index = radius_neighbours(points, keypoints, radius_m)
        frames, variance = local_frames(points, keypoints, start, index, radius_m)
        # A keypoint that is a point of the cloud is its own neighbour and adds nothing.
        on_a_line = variance[:, 1] <= _FLATTEST * variance[:, 2]
        valid = (np.diff(start) >= least) & ~on_a_line
        descriptors = histograms(points, normals, keypoints, frames, start, index, radius_m, cfg.signed_normals)
        descriptors[~valid] = 0.0
        return FeaturesDescription3DOutputs(descriptors=descriptors, valid=valid)
