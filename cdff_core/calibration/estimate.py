# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate of a mount with its covariance and the directions that a drive does not determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray

#: Names of the six directions of a mount, in the axes of the base.
DIRECTIONS = ("x", "y", "z", "roll", "pitch", "yaw")
#: Largest standard deviation of a determined direction, metres and radians.
LIMITS = np.array([0.1] * 3 + [np.deg2rad(3.0)] * 3)
#: Information of a weak prior (10 m and 180°), which makes the information of every drive invertible.
WEAK_PRIOR = np.diag([1e-2] * 3 + [1.0 / np.pi**2] * 3)


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Mount ``T_base_sensor`` of a sensor.

    Attributes
    ----------
    transform : UncertainTransform
        The estimate with its covariance. A direction that the drive does not determine has the value of the
        prior and its large standard deviation.
    undetermined : tuple of str
        Directions of ``DIRECTIONS`` whose standard deviation exceeds ``LIMITS``.
    pairs : int
        Number of compared motions.
    rms_m, rms_rad : float
        Root mean square of the residuals of translation and rotation of a motion.
    """

    transform: UncertainTransform
    undetermined: tuple[str, ...]
    pairs: int
    rms_m: float
    rms_rad: float

    @classmethod
    def of_covariance(
        cls, T: FloatArray, covariance: FloatArray, pairs: int, *, rms_m: float, rms_rad: float
    ) -> Mount:
        """Return the mount; directions whose standard deviation exceeds its limit are undetermined."""
        symmetric = 0.5 * (covariance + covariance.T)
        sigma = np.sqrt(np.diag(symmetric))
        undetermined = tuple(n for n, s, limit in zip(DIRECTIONS, sigma, LIMITS, strict=True) if s > limit)
        return cls(UncertainTransform(T, symmetric), undetermined, pairs, rms_m, rms_rad)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations ``(6,)``, metres and radians."""
        assert self.transform.covariance is not None
        return np.sqrt(np.diag(self.transform.covariance))

    def require(self, directions: tuple[str, ...] = DIRECTIONS) -> None:
        """Raise DegenerateGeometryError if one of the directions is not determined, with what to drive."""
        missing = tuple(d for d in directions if d in self.undetermined)
        if missing:
            raise DegenerateGeometryError(
                f"the drive does not determine {', '.join(missing)} of the mount: {advice(missing)}", missing
            )

    def completed(self, known: UncertainTransform) -> UncertainTransform:
        """Return the mount with the undetermined directions, and their standard deviations, of a known mount.

        A translation is replaced by axis. If an angle is undetermined, all three are those of the known
        mount, since the axes of roll, pitch and yaw depend on each other. Where the known mount has no
        covariance or is exact, ``LIMITS`` are the standard deviations.
        """
        assert self.transform.covariance is not None
        T, covariance = self.transform.matrix.copy(), self.transform.covariance.copy()
        replaced = [name in self.undetermined for name in DIRECTIONS]
        if any(replaced[3:]):
            replaced[3:] = [True] * 3
            T[:3, :3] = known.matrix[:3, :3]
        stated_variances = np.zeros(6) if known.covariance is None else np.diag(known.covariance)
        for k in np.flatnonzero(replaced):
            covariance[k], covariance[:, k] = 0.0, 0.0
            covariance[k, k] = stated_variances[k] or LIMITS[k] ** 2
            if k < 3:
                T[k, 3] = known.matrix[k, 3]
        return UncertainTransform(se3.normalise_transform(T), covariance)


def advice(directions: tuple[str, ...]) -> str:
    """Return what a drive needs to determine the directions."""
    parts = []
    if {"x", "y"} & set(directions):
        parts.append("drive curves of at least 90° to both sides")
    if "z" in directions:
        parts.append("measure the height, or drive over slopes that tilt the robot")
    if {"roll", "pitch"} & set(directions):
        parts.append("drive curves, or over slopes that tilt the robot")
    if "yaw" in directions:
        parts.append("drive at least 5 m, and accelerate and brake several times")
    return "; ".join(parts)
