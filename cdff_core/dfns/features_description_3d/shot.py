# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SHOT: signatures of histograms of orientations, 352 values."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_core.dfns.features_description_3d._shot_kernels import histograms, local_frames
from cdff_core.dfns.features_description_3d._support import SupportConfig, checked_support
from cdff_core.dfns.features_description_3d.interface import Inputs, Interface, Outputs

#: Ratio of the second largest to the largest variance below which the points of a support lie on a line.
_MIN_VARIANCE_RATIO = 1e-6


class ShotConfig(SupportConfig):
    """Parameters of Shot."""

    signed_normals: bool = Field(True, description="Treat a normal and its opposite as different")


class Shot(Interface[ShotConfig]):
    """Histograms of the cosines between normals and the local z axis, for 8 x 2 x 2 sectors of a sphere.

    Notes
    -----
    Tombari, Salti, Di Stefano (2010), doi:10.1007/978-3-642-15558-1_26; Salti, Tombari, Di Stefano (2014),
    doi:10.1016/j.cviu.2014.04.011. Local frame: eigenvectors of the scatter about the keypoint, weighted by
    ``R - d``, with radius R and distance d; x (largest variance) and z (smallest variance) point to the side
    with more neighbours, y completes a right-handed frame. The cosines of each sector have 11 bins.
    Interpolation is quadrilinear as in the papers, by the product of the weights of the four dimensions; PCL
    adds the weights instead.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.5], [1, 1, 0], [0.5, 0, 0]])
        up = np.tile([0.0, 0.0, 1.0], (len(corners), 1))
        self._describe(corners, up, corners[:1], 2.0, 3)

    def process(self, inputs: Inputs) -> Outputs:
        """Return one descriptor per keypoint; raises InputError on malformed clouds."""
        points, normals, keypoints, radius_m = checked_support(inputs, self.config)
        return self._describe(points, normals, keypoints, radius_m, self.config.least_neighbours)

    def _describe(
        self,
        points: FloatArray,
        normals: FloatArray,
        keypoints: FloatArray,
        radius_m: float,
        min_neighbours: int,
    ) -> Outputs:
        """Return one descriptor per keypoint."""
        cfg = self.config
        start, index = radius_neighbours(points, keypoints, radius_m)
        frames, variance = local_frames(points, keypoints, start, index, radius_m)
        on_a_line = variance[:, 1] <= _MIN_VARIANCE_RATIO * variance[:, 2]
        valid = (np.diff(start) >= min_neighbours) & ~on_a_line
        descriptors = histograms(
            points, normals, keypoints, frames, start, index, radius_m, cfg.signed_normals
        )
        descriptors[~valid] = 0.0
        return Outputs(descriptors=descriptors, valid=valid)
