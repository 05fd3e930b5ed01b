# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""FPFH: fast point feature histograms, 33 values."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_core.dfns.features_description_3d._fpfh_kernels import simplified_histograms, weighted_histograms
from cdff_core.dfns.features_description_3d._support import SupportConfig, checked_support
from cdff_core.dfns.features_description_3d.interface import Inputs, Interface, Outputs


class Fpfh(Interface[SupportConfig]):
    """Histograms of the three angles between pairs of normals, summed over the neighbours of the keypoint.

    Rusu, Blodow, Beetz (2009), doi:10.1109/ROBOT.2009.5152473. Neighbours are weighted by the inverse of
    their squared distance, as in PCL and Open3D. A keypoint need not be a point of the cloud: the histogram
    of the nearest point is used as its own.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        self._describe(corners, np.tile([0.0, 0.0, 1.0], (3, 1)), corners[:1], 2.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return one descriptor per keypoint; raises InputError on malformed clouds."""
        return self._describe(*checked_support(inputs, self.config))

    def _describe(
        self, points: FloatArray, normals: FloatArray, keypoints: FloatArray, radius_m: float
    ) -> Outputs:
        """Return one descriptor per keypoint."""
        from scipy.spatial import cKDTree

        start, index = radius_neighbours(points, keypoints, radius_m)
        _, nearest = cKDTree(points).query(keypoints)
        rows = np.unique(np.concatenate([index, nearest]))
        spfh = simplified_histograms(
            points, normals, rows, *radius_neighbours(points, points[rows], radius_m)
        )
        spfh_row = np.full(len(points), -1, np.int64)
        spfh_row[rows] = np.arange(len(rows))
        descriptors = spfh[spfh_row[nearest]] + weighted_histograms(
            points, keypoints, spfh, spfh_row, start, index
        )
        valid = np.diff(start) >= self.config.least_neighbours
        descriptors[~valid] = 0.0
        return Outputs(descriptors=descriptors.astype(np.float32), valid=valid)
