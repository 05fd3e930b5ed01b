# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude by Wahba's problem with rejection of outliers."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.bearing_tracking import wahba
from cdff_core.dfns.attitude_from_directions.interface import Inputs, Interface, Outputs

#: Largest number of rejections of outliers.
_ROUNDS = 5


class WeightedWahbaConfig(DfnConfig):
    """Parameters of WeightedWahba."""

    min_directions: int = Field(
        2, ge=2, le=1000, description="Number of directions below which it is refused"
    )
    max_sigmas: float = Field(
        4.0, ge=2.0, le=20.0, description="Residual from which a pair is an outlier, sigmas"
    )
    floor_rad: float = Field(
        1e-7,
        ge=0.0,
        le=0.1,
        description="Error of each pair beyond its sigma, for example of the catalogue, rad",
    )


class WeightedWahba(Interface[WeightedWahbaConfig]):
    """Markley's solution by singular values with the covariance of Shuster and Oh, see
    ``bearing_tracking.wahba``.

    The covariance grows with the mean squared residual where that is larger than one.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return rotation, covariance and inliers.

        Raises
        ------
        RefusedError
            If fewer directions than the limit remain.
        DegenerateGeometryError
            If the directions are closer together than their errors.
        """
        sigmas = np.hypot(inputs.sigmas, self.config.floor_rad)
        inliers = np.ones(len(sigmas), bool)
        for _ in range(_ROUNDS):
            self._check_count(int(inliers.sum()))
            b, r, s = inputs.directions[inliers], inputs.references[inliers], sigmas[inliers]
            R = wahba.rotation(b, r, 1.0 / s**2)
            angles = np.linalg.norm(inputs.references - inputs.directions @ R.T, axis=1)
            # The median resists gross errors; the angle has two components.
            scale = max(float(np.median(angles[inliers] / s)) / 1.1774, 1.0)
            remaining = angles <= self.config.max_sigmas * scale * sigmas
            if np.array_equal(remaining, inliers):
                break
            inliers = remaining
        self._check_count(int(inliers.sum()))
        information = wahba.information(inputs.references[inliers], sigmas[inliers])
        eigenvalues = np.linalg.eigvalsh(information)
        if not eigenvalues[0] > 1.0:
            raise DegenerateGeometryError(
                f"{inliers.sum()} directions are closer together than their errors: expected a rotation about"
                f" them known to 1 rad, got {1.0 / np.sqrt(max(eigenvalues[0], 1e-12)):.2g} rad"
            )
        freedom = max(2 * int(inliers.sum()) - 3, 1)
        excess = max(float(((angles / sigmas)[inliers] ** 2).sum()) / freedom, 1.0)
        return Outputs(
            rotation=R,
            covariance=np.asarray(np.linalg.inv(information) * excess, np.float64),
            inliers=inliers,
            residual=float(np.sqrt((angles[inliers] ** 2).mean())),
        )

    def _check_count(self, count: int) -> None:
        if count < self.config.min_directions:
            raise RefusedError(
                f"{count} directions agree, expected at least {self.config.min_directions}",
                reasons=[f"few_directions:{count}<{self.config.min_directions}"],
            )
