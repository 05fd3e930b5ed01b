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

#: A patch is 2 * 7 + 1 pixels wide.
HALF_WINDOW_PX = 7
#: Step size that ends the iteration.
TOLERANCE_PX = 0.01
#: Minimum normalised cross-correlation of both patches, and largest distance of a point tracked forward and
#: back from its start.
MIN_CORRELATION, MAX_RETURN_ERROR_PX = 0.85, 0.5


class WarpedKltConfig(DfnConfig):
    """Parameters of WarpedKlt."""

    levels: int = Field(
        3,
        ge=1,
        le=8,
        description="Number of levels of the image pyramid; each additional one doubles the search range",
    )
    iterations: int = Field(12, ge=1, le=100, description="Maximum number of Gauss-Newton steps per level")


def arrays_of(inputs: Inputs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return points ``(n, 2)``, guess ``(n, 2)`` and warps ``(n, 3, 3)``; absent ones get default values."""
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

    Patches are resampled with the expected warp, so that points approached by a quarter of their distance, or
    on ground seen at a grazing angle, are tracked without bias. Gain and offset of a patch are removed, so
    that changes of exposure have no effect.

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
        cfg = self.config
        points, guess, warps = arrays_of(inputs)
        reference, image = pyramid(inputs.reference, cfg.levels), pyramid(inputs.image, cfg.levels)
        matches, scores = self._track_coarse_to_fine(reference, image, points, guess, warps)
        tracked_back, backward_scores = align_patches(
            image[0],
            reference[0],
            matches,
            points,
            np.linalg.inv(warps),
            HALF_WINDOW_PX,
            cfg.iterations,
            TOLERANCE_PX,
        )
        valid = (scores >= MIN_CORRELATION) & (backward_scores >= MIN_CORRELATION)
        valid &= np.hypot(*(tracked_back - points).T) <= MAX_RETURN_ERROR_PX
        return Outputs(matches=matches, valid=valid, scores=scores)

    def _track_coarse_to_fine(
        self,
        reference: list[Float32Array],
        image: list[Float32Array],
        points: FloatArray,
        guess: FloatArray,
        warps: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return positions ``(n, 2)`` and scores ``(n,)``.

        A level on which the score of a point is at most 0.5 does not change its guess for the next one.
        """
        cfg = self.config
        positions, scores = guess, np.full(len(points), -1.0)
        for level in range(len(image) - 1, -1, -1):
            scale = 2.0**level
            level_warps = warps.copy()
            level_warps[:, 2, :2] *= scale  # these elements are per pixel, of this level
            refined_positions, scores = align_patches(
                reference[level],
                image[level],
                points / scale,
                positions / scale,
                level_warps,
                HALF_WINDOW_PX,
                cfg.iterations,
                TOLERANCE_PX * (1.0 if level == 0 else 5.0),
            )
            positions = np.where((scores > 0.5)[:, None] | (level == 0), refined_positions * scale, positions)
        return positions, scores
