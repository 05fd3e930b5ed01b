# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/eigen.asn by cdff generate; do not edit.

"""Types of ``asn1/eigen.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Vector2d(Message):
    """Type ``Vector2d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (2,)
    """

    ASN1_NAME: ClassVar[str] = "Vector2d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Vector3d(Message):
    """Type ``Vector3d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (3,)
    """

    ASN1_NAME: ClassVar[str] = "Vector3d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Vector4d(Message):
    """Type ``Vector4d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4,)
    """

    ASN1_NAME: ClassVar[str] = "Vector4d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Vector6d(Message):
    """Type ``Vector6d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (6,)
    """

    ASN1_NAME: ClassVar[str] = "Vector6d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VectorXd(Message):
    """Type ``VectorXd`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (0..100,)
    """

    ASN1_NAME: ClassVar[str] = "VectorXd"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Quaterniond(Message):
    """x, y, z, w.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4,)
    """

    ASN1_NAME: ClassVar[str] = "Quaterniond"
    values: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AngleAxisd(Message):
    """Type ``AngleAxisd`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4,)
    """

    ASN1_NAME: ClassVar[str] = "AngleAxisd"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Matrix2d(Message):
    """Type ``Matrix2d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (2, 2)
    """

    ASN1_NAME: ClassVar[str] = "Matrix2d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 2), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Matrix3d(Message):
    """Type ``Matrix3d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (3, 3)
    """

    ASN1_NAME: ClassVar[str] = "Matrix3d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Matrix4d(Message):
    """Type ``Matrix4d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4, 4)
    """

    ASN1_NAME: ClassVar[str] = "Matrix4d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4, 4), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Matrix6d(Message):
    """Type ``Matrix6d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (6, 6)
    """

    ASN1_NAME: ClassVar[str] = "Matrix6d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 6), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MatrixXd(Message):
    """Type ``MatrixXd`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (0..20, 0..20)
    """

    ASN1_NAME: ClassVar[str] = "MatrixXd"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Affine3d(Message):
    """Type ``Affine3d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4, 4)
    """

    ASN1_NAME: ClassVar[str] = "Affine3d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4, 4), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Isometry3d(Message):
    """Type ``Isometry3d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4, 4)
    """

    ASN1_NAME: ClassVar[str] = "Isometry3d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4, 4), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Transform3d(Message):
    """Type ``Transform3d`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4, 4)
    """

    ASN1_NAME: ClassVar[str] = "Transform3d"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4, 4), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Covariance(Message):
    """Order x y z rx ry rz; metres and radians; perturbation in the parent frame. NaN where unknown.

    Attributes
    ----------
    values : NDArray[np.float64], shape (6, 6)
    """

    ASN1_NAME: ClassVar[str] = "Covariance"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 6), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Point(Message):
    """Type ``Point`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (3,)
    """

    ASN1_NAME: ClassVar[str] = "Point"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Point2D(Message):
    """Type ``Point2D`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (2,)
    """

    ASN1_NAME: ClassVar[str] = "Point2D"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Point3D(Message):
    """Type ``Point3D`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (3,)
    """

    ASN1_NAME: ClassVar[str] = "Point3D"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Angle(Message):
    """Type ``Angle`` of the ASN.1 modules.

    Attributes
    ----------
    rad : float
        rad.
    """

    ASN1_NAME: ClassVar[str] = "Angle"
    rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AngleSegment(Message):
    """Type ``AngleSegment`` of the ASN.1 modules.

    Attributes
    ----------
    start_rad : float
        rad.
    width : float
        rad, counter-clockwise from startRad.
    """

    ASN1_NAME: ClassVar[str] = "AngleSegment"
    start_rad: float = 0.0
    width: float = 0.0
