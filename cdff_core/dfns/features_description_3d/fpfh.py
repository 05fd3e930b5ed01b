# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""FPFH: fast point feature histograms, 33 values."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_description_3d._interface import (
    FeaturesDescription3DInputs,
    FeaturesDescription3DInterface,
    FeaturesDescription3DOutputs,
)
from cdff_core.dfns.features_description_3d._support import Float, SupportConfig, checked_support


class FpfhConfig(SupportConfig):
    """Size of the support."""


class Fpfh(FeaturesDescription3DInterface):
    """Histograms of the three angles between pairs of normals, summed over the neighbours of the keypoint.

    Rusu, Blodow, Beetz (2009), doi:10.1109/ROBOT.2009.5152473. Neighbours weigh the inverse of their squared distance,
    as PCL and Open3D do it, and a keypoint's own histogram is that of the point nearest to it.
    """

    Config: ClassVar[type[DfnConfig]] = FpfhConfig

    def setup(self) -> None:
        """Compile the kernels, so that the first call costs what the others do."""
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        self._described(corners, np.tile([0.0, 0.0, 1.0], (3, 1)), corners[:1], 2.0)

    def process(self, inputs: FeaturesDescription3DInputs) -> FeaturesDescription3DOutputs:
        """Return one descriptor per keypoint; raises InputError on malformed clouds."""
        return self._described(*checked_support(inputs, self.config))

    def _described(
        self, points: Float, normals: Float, keypoints: Float, radius_m: float
    ) -> FeaturesDescription3DOutputs:
        from scipy.spatial import cKDTree

        from cdff_common.geometry.neighbours import radius_neighbours
        from cdff_core.dfns.features_description_3d._fpfh_kernels import simplified, weighted

        start, index = radius_neighbours(points, keypoints, radius_m)
        _, nearest = cKDTree(points).query(keypoints)
        which = np.unique(np.concatenate([index, nearest]))
        spfh = simplified(points, normals, which, *radius_neighbours(points, points[which], radius_m))
        row = np.full(len(points), -1, np.int64)
        row[which] = np.arange(len(which))
        descriptors = spfh[row[nearest]] + weighted(points, keypoints, spfh, row, start, index)
        valid = np.diff(start) >= self.config.least_neighbours
        descriptors[~valid] = 0.0
        return FeaturesDescription3DOutputs(descriptors=descriptors.astype(np.float32), valid=valid)
