# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Directions that a registration with the local map does not constrain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfns.scan_to_map_registration.interface import ScanToMapRegistrationOutputs

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """Degenerate directions of a registration.

    Attributes
    ----------
    rows : ndarray, shape (k, 6)
        Unit vectors of translation, and of rotation times the radius.
    scale : ndarray, shape (6,)
        1 for translations, the radius in metres for rotations.
    sigma_m, gains : ndarray, shape (k,)
        Standard deviation along each direction from the map alone, and weight of the map (0 to 1).
    """

    rows: Float
    scale: Float
    sigma_m: Float
    gains: Float

    def projection(self, weights: Float) -> Float:
        """Return the matrix (6, 6) that projects a pose error on the directions, times their weights (k,)."""
        return (self.rows.T * weights) @ self.rows * self.scale[None, :] / self.scale[:, None]

    @property
    def covariance(self) -> Float:
        """Covariance (6, 6), m and rad, that the map contributes to the pose along the directions."""
        weights = (self.gains * self.sigma_m) ** 2
        return (self.rows.T * weights) @ self.rows / np.outer(self.scale, self.scale)


def degenerate_directions(
    registration: ScanToMapRegistrationOutputs | None, max_sigma_m: float
) -> Directions:
    """Return the directions with a standard deviation above
    ``max_sigma_m``; all six without a registration.
    """
    if registration is None:
        return Directions(np.eye(6), np.ones(6), np.zeros(6), np.zeros(6))
    is_degenerate = registration.sigma_m > max_sigma_m
    return Directions(
        rows=registration.directions[is_degenerate],
        scale=np.concatenate([np.ones(3), np.full(3, max(registration.radius_m, 1e-6))]),
        sigma_m=registration.sigma_m[is_degenerate],
        gains=registration.gains[is_degenerate],
    )
