# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform with covariance: the value type of frame edges, pose tracks and pose products."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import rotation_forms, se3
from cdff_common.geometry.se3 import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class UncertainTransform:
    """Transform ``T_a_b`` with an optional covariance.

    Attributes
    ----------
    matrix : NDArray[np.float64], shape (4, 4)
        Maps coordinates in b into a, metres.
    covariance : NDArray[np.float64], shape (6, 6), or None
        ``[x y z rx ry rz]``, error in a (see ``geometry.covariance``); None if unknown.
    """

    matrix: FloatArray
    covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=np.float64)
        if not se3.is_transform(matrix, tolerance=1e-5):
            raise InputError(f"transform {matrix.tolist()}: expected a finite rigid 4x4 transform")
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)
        if self.covariance is not None:
            c = cov.checked_covariance(self.covariance)
            c.setflags(write=False)
            object.__setattr__(self, "covariance", c)

    @classmethod
    def identity(cls) -> UncertainTransform:
        """Return the exact identity, a shared object with which composition is free."""
        return _IDENTITY

    def equals(self, other: UncertainTransform) -> bool:
        """Return whether both have exactly the same matrix and covariance."""
        if self.covariance is None or other.covariance is None:
            return self.covariance is other.covariance and np.array_equal(self.matrix, other.matrix)
        return np.array_equal(self.matrix, other.matrix) and np.array_equal(self.covariance, other.covariance)

    @classmethod
    def exact(cls, matrix: ArrayLike) -> UncertainTransform:
        """Return a transform ``(4, 4)`` with zero covariance, such as a mount."""
        return cls(np.asarray(matrix, dtype=np.float64), np.zeros((6, 6)))

    @classmethod
    def from_xyz_rpy_deg(
        cls, xyz_m: ArrayLike, rpy_deg: ArrayLike, *, sigma_m: float = 0.0, sigma_deg: float = 0.0
    ) -> UncertainTransform:
        """Return ``T_a_b`` of the origin of b in a, metres, and roll, pitch, yaw of b in a, degrees.

        Parameters
        ----------
        xyz_m, rpy_deg : array_like, shape (3,)
            The rotations are about the fixed axes x, y, z of a, in this order.
        sigma_m, sigma_deg : float
            Standard deviation per axis; both 0: known exactly.

        Raises
        ------
        InputError
            If a number is not finite, or a standard deviation is negative.
        """
        R = rotation_forms.matrix_from_rpy_deg(rpy_deg)
        return cls(se3.transform(R, xyz_m), rotation_forms.isotropic_covariance(sigma_m, sigma_deg))

    @classmethod
    def from_quaternion(
        cls,
        xyz_m: ArrayLike,
        *,
        xyzw: ArrayLike | None = None,
        wxyz: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
    ) -> UncertainTransform:
        """Return ``T_a_b`` of the origin of b in a, metres, and a unit quaternion whose order is named.

        Raises
        ------
        InputError
            Unless exactly one quaternion is given, of unit length within 1 %.
        """
        R = rotation_forms.matrix_from_quaternion(xyzw=xyzw, wxyz=wxyz)
        c = None if covariance is None else np.asarray(covariance, dtype=np.float64)
        return cls(se3.transform(R, xyz_m), c)

    @classmethod
    def from_ros(cls, message: Any) -> UncertainTransform:
        """Return ``T_a_b`` of a ROS message with a pose or transform, with its covariance if it has one.

        See Also
        --------
        rotation_forms.parts_of_ros : Accepted messages and errors.
        """
        translation_m, R, covariance = rotation_forms.parts_of_ros(message)
        return cls(se3.transform(R, translation_m), covariance)

    def inverse(self) -> UncertainTransform:
        """Return ``T_b_a`` with its covariance in b."""
        c = None if self.covariance is None else cov.inverse_covariance(self.matrix, self.covariance)
        return UncertainTransform(se3.inverse(self.matrix), c)

    def __matmul__(self, other: UncertainTransform) -> UncertainTransform:
        """Return ``T_a_c = T_a_b @ T_b_c``; without covariance if either has none."""
        if other is _IDENTITY:
            return self
        if self is _IDENTITY:
            return other
        c = None
        if self.covariance is not None and other.covariance is not None:
            c = cov.compose_covariance(self.matrix, self.covariance, other.matrix, other.covariance)
        return UncertainTransform(self.matrix @ other.matrix, c)

    def apply(self, points_b: ArrayLike) -> FloatArray:
        """Map points ``(n, 3)`` in b into a, metres."""
        return se3.transform_points(self.matrix, points_b)


_IDENTITY = UncertainTransform(np.eye(4), np.zeros((6, 6)))


def interpolate(first: UncertainTransform, second: UncertainTransform, fraction: float) -> UncertainTransform:
    """Interpolate between two poses of one track: translation linearly, rotation along the geodesic.

    Parameters
    ----------
    first, second : UncertainTransform
        ``T_a_b`` at two times.
    fraction : float
        0 returns ``first``, 1 returns ``second``; InputError outside [0, 1].

    Notes
    -----
    Covariances are interpolated linearly: neighbouring poses of a track share most of their error, and for
    fully correlated errors this is an upper bound.

    See Also
    --------
    se3.interpolate_transform : The same without covariance.
    """
    if not 0.0 <= fraction <= 1.0:
        raise InputError(f"fraction={fraction}: expected 0 to 1; no extrapolation")
    c = None
    if first.covariance is not None and second.covariance is not None:
        c = (1.0 - fraction) * first.covariance + fraction * second.covariance
    return UncertainTransform(se3.interpolate_transform(first.matrix, second.matrix, fraction), c)
