# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lucas-Kanade tracking of patches warped by a predicted motion."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_tracking_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.patch_alignment import align_patches
from cdff_core.imaging.pyramid import pyramid

#: Half width of a patch without its centre pixel.
HALF_WINDOW_PX = 7
#: Step size that ends the iteration.
TOLERANCE_PX = 0.01
#: Minimum correlation of the patches of a track, and largest distance after tracking forward and back.
MIN_CORRELATION, MAX_RETURN_ERROR_PX = 0.85, 0.5


class WarpedKltConfig(DfnConfig):
    """Parameters of WarpedKlt."""

    levels: int = Field(
        3, ge=1, le=8, description="Levels of the image pyramid; each doubles the search range"
    )
    iterations: int = Field(12, ge=1, le=100, description="Gauss-Newton steps per level")


def arrays_of(inputs: Inputs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return points, guess and warps; a patch without a warp is not changed."""
    points = np.array(inputs.features, np.float64)
    guess = points if inputs.guess is None else np.array(inputs.guess, np.float64)
    warps = (
        np.tile(np.eye(3), (len(points), 1, 1))
        if inputs.warps is None
        else np.array(inputs.warps, np.float64)
    )
    return points, guess, warps


class WarpedKlt(Interface[WarpedKltConfig]):
    """Inverse-compositional Lucas-Kanade [1]_ over a pyramid [2]_, forward and backward [3]_.

    The patch is resampled with the expected warp, so that a point approached by a quarter of its distance, or
    on ground at a grazing angle, is tracked without bias. Gain and offset of the patch are removed, so that
    exposure may change.

    References
    ----------
    .. [1] S. Baker, I. Matthews, Lucas-Kanade 20 Years On, IJCV 56(3), 2004,
      doi:10.1023/B:VISI.0000011205.11775.fd
    .. [2] J.-Y. Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker, Intel, 2000
    .. [3] Z. Kalal et al., Forward-Backward Error, ICPR 2010, doi:10.1109/ICPR.2010.675
    """

    def setup(self) -> None:
        """Compile the kernel."""
        image, point = np.zeros((48, 48), np.float32), np.full((1, 2), 24.0)
        align_patches(image, image, point, point, np.eye(3)[None], 3, 1, 0.1)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the tracked points; raises InputError on images that are too small."""
        c = self.config
        points, guess, warps = arrays_of(inputs)
        reference, image = pyramid(inputs.reference, c.levels), pyramid(inputs.image, c.levels)
        matches, scores = self._descend(reference, image, points, guess, warps)
        back, returned = align_patches(
            image[0],
            reference[0],
            matches,
            points,
            np.linalg.inv(warps),
            HALF_WINDOW_PX,
            c.iterations,
            TOLERANCE_PX,
        )
        valid = (scores >= MIN_CORRELATION) & (returned >= MIN_CORRELATION)
        valid &= np.hypot(*(back - points).T) <= MAX_RETURN_ERROR_PX
        return Outputs(matches=matches, valid=valid, scores=scores)

    def _descend(
        self,
        reference: list[Float32Array],
        image: list[Float32Array],
        points: FloatArray,
        guess: FloatArray,
        warps: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Track from coarse to fine; a level on which a point is not found does not change its guess."""
        c = self.config
        found, scores = guess, np.full(len(points), -1.0)
        for level in range(len(image) - 1, -1, -1):
            size = 2.0**level
            coarse = warps.copy()
            coarse[:, 2, :2] *= size  # per pixel of this level
            finer, scores = align_patches(
                reference[level],
                image[level],
                points / size,
                found / size,
                coarse,
                HALF_WINDOW_PX,
                c.iterations,
                TOLERANCE_PX * (1.0 if level == 0 else 5.0),
            )
            found = np.where((scores > 0.5)[:, None] | (level == 0), finer * size, found)
        return found, scores
