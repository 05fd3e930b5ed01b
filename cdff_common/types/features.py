# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/features.asn by cdff generate; do not edit.

"""Types of ``asn1/features.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.features_ext import (
    CorrespondenceMap2DExt,
    CorrespondenceMap3DExt,
    VisualPointFeatureVector2DExt,
    VisualPointFeatureVector3DExt,
)
from cdff_common.types.message import ChoiceMessage, Message


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Correspondence2D(Message):
    """Type ``Correspondence2D`` of the ASN.1 modules.

    Attributes
    ----------
    source : NDArray[np.float64], shape (2,)
        px.
    sink : NDArray[np.float64], shape (2,)
        px.
    probability : float
    """

    ASN1_NAME: ClassVar[str] = "Correspondence2D"
    source: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))
    sink: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))
    probability: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMap2D(CorrespondenceMap2DExt):
    """Pairs of points in two images.

    Attributes
    ----------
    items : tuple[Correspondence2D, ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMap2D"
    items: tuple[Correspondence2D, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Correspondence3D(Message):
    """Type ``Correspondence3D`` of the ASN.1 modules.

    Attributes
    ----------
    source : NDArray[np.float64], shape (3,)
        m.
    sink : NDArray[np.float64], shape (3,)
        m.
    probability : float
    """

    ASN1_NAME: ClassVar[str] = "Correspondence3D"
    source: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    sink: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    probability: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMap3D(CorrespondenceMap3DExt):
    """Pairs of points in two clouds.

    Attributes
    ----------
    items : tuple[Correspondence3D, ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMap3D"
    items: tuple[Correspondence3D, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeature2D(Message):
    """Type ``VisualPointFeature2D`` of the ASN.1 modules.

    Attributes
    ----------
    point : NDArray[np.float64], shape (2,)
        px.
    descriptor : NDArray[np.float64], shape (0..128,)
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeature2D"
    point: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))
    descriptor: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeatureVector2D(VisualPointFeatureVector2DExt):
    """Points of an image with descriptors.

    Attributes
    ----------
    items : tuple[VisualPointFeature2D, ...]
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeatureVector2D"
    items: tuple[VisualPointFeature2D, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Point3DReference(Message):
    """Point given by its index in a cloud.

    Attributes
    ----------
    point_cloud_identifier : int, 0..65535
    index : int, 0..9223372036854775807
    """

    ASN1_NAME: ClassVar[str] = "Point3DReference"
    point_cloud_identifier: int = 0
    index: int = 0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeature3DPoint(ChoiceMessage):
    """Value of ``point`` of a ``VisualPointFeature3D``: one of several kinds.

    Attributes
    ----------
    kind : str
        Name of the alternative: ``position``, ``reference``.
    value : NDArray[np.float64] | Point3DReference
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeature3D-point"
    kind: str = "position"
    value: NDArray[np.float64] | Point3DReference = field(default_factory=lambda: np.zeros((3,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeature3D(Message):
    """Type ``VisualPointFeature3D`` of the ASN.1 modules.

    Attributes
    ----------
    point : VisualPointFeature3DPoint
    descriptor : NDArray[np.float64], shape (0..352,)
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeature3D"
    point: VisualPointFeature3DPoint = field(default_factory=VisualPointFeature3DPoint)
    descriptor: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))


class VisualPointFeatureVector3DType(IntEnum):
    """``VisualPointFeatureVector3DType``."""

    ALL_POSITIONS = 0
    ALL_REFERENCES = 1
    HYBRID_VECTOR = 2


class VisualPointFeature3DType(IntEnum):
    """``VisualPointFeature3DType``."""

    HISTOGRAM = 0
    SHOT = 1
    PFH = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeatureVector3D(VisualPointFeatureVector3DExt):
    """Points of a cloud with descriptors.

    Attributes
    ----------
    list : tuple[VisualPointFeature3D, ...]
    list_type : VisualPointFeatureVector3DType
    feature_type : VisualPointFeature3DType
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeatureVector3D"
    list: tuple[VisualPointFeature3D, ...] = ()
    list_type: VisualPointFeatureVector3DType = VisualPointFeatureVector3DType.ALL_POSITIONS
    feature_type: VisualPointFeature3DType = VisualPointFeature3DType.HISTOGRAM
