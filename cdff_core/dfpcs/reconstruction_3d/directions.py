# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Directions of the pose that the points of a surface constrain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """Information of a registration, for displacements of the centre of the points and rotations about it.

    Rotations are multiplied by the radius of the points, so that all six coordinates are lengths.

    Attributes
    ----------
    centre_m : ndarray, shape (3,)
        Centre of the points in the frame of the model.
    radius_m : float
        Root mean square distance of the points from the centre.
    values : ndarray, shape (k,)
        Information per point along the constrained directions.
    strong, weak : ndarray, shape (k, 6), (6 - k, 6)
        Constrained and unconstrained directions, unit vectors.
    points : int
    """

    centre_m: FloatArray
    radius_m: float
    values: FloatArray
    strong: FloatArray
    weak: FloatArray
    points: int

    @classmethod
    def of(
        cls, points_m: FloatArray, normals: FloatArray, other_normals: FloatArray, min_information: float
    ) -> Directions:
        """Return the directions of points (n, 3) with two independent estimates of their normals (n, 3).

        The errors of the two estimates are independent, so that noise contributes no information to their
        product. Directions with less information per point than ``min_information`` are unconstrained.
        """
        centre = points_m.mean(axis=0)
        arms = points_m - centre
        radius_m = float(np.sqrt(np.mean(np.sum(arms**2, axis=1))))
        J, K = (np.hstack([n, np.cross(arms, n) / radius_m]) for n in (normals, other_normals))
        values, vectors = np.linalg.eigh((J.T @ K + K.T @ J) / (2.0 * len(J)))
        is_strong = values >= min_information
        return cls(
            centre, radius_m, values[is_strong], vectors[:, is_strong].T, vectors[:, ~is_strong].T, len(J)
        )

    @property
    def to_model(self) -> FloatArray:
        """Matrix (6, 6) from the coordinates to displacement and rotation about the origin of the model."""
        return np.block(
            [
                [np.eye(3), se3.skew(self.centre_m) / self.radius_m],
                [np.zeros((3, 3)), np.eye(3) / self.radius_m],
            ]
        )

    def covariance(self, variance: float) -> FloatArray:
        """Return the covariance (6, 6) along the constrained directions; ``variance`` is that of a point."""
        return np.asarray(variance / self.points * (self.strong.T / self.values) @ self.strong)

    def correction(self, T_start: FloatArray, T_end: FloatArray) -> FloatArray:
        """Return the coordinates (6,) of the motion between two poses (4, 4)."""
        motion = T_end @ se3.inverse(T_start)
        start_m = se3.transform_points(se3.inverse(motion), self.centre_m[None])[0]
        return np.concatenate([self.centre_m - start_m, self.radius_m * se3.log_so3(motion[:3, :3])])

    def strong_part(self, correction: FloatArray) -> FloatArray:
        """Return the part (6,) of a correction along the constrained directions."""
        return np.asarray(correction @ self.strong.T @ self.strong)

    def moved(self, T_start: FloatArray, correction: FloatArray) -> FloatArray:
        """Return the pose (4, 4) after a correction whose motion ends at the centre."""
        R = se3.exp_so3(correction[3:] / self.radius_m)
        start_m = self.centre_m - correction[:3]
        return np.asarray(se3.transform(R, self.centre_m - R @ start_m) @ T_start)
