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

from cdff_common.errors import InputError
from cdff_common.types import validation as check
from cdff_common.types.features_ext import (
    CorrespondenceMap2DExt,
    CorrespondenceMap3DExt,
    VisualPointFeatureVector2DExt,
    VisualPointFeatureVector3DExt,
)
from cdff_common.types.message import Message


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Correspondence2D(Message):
    """What a ``Correspondence2D`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "source", check.real_array(self.source, "Correspondence2D.source", ((2, 2),)))
        put(self, "sink", check.real_array(self.sink, "Correspondence2D.sink", ((2, 2),)))
        put(self, "probability", check.real(self.probability, "Correspondence2D.probability"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMap2D(CorrespondenceMap2DExt):
    """Pairs of points in two images.

    Attributes
    ----------
    items : tuple[Correspondence2D, ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMap2D"
    items: tuple[Correspondence2D, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(
                self.items, "CorrespondenceMap2D.items", 0, 1048576, lambda v, w: check.instance(v, w, Correspondence2D)
            ),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Correspondence3D(Message):
    """What a ``Correspondence3D`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "source", check.real_array(self.source, "Correspondence3D.source", ((3, 3),)))
        put(self, "sink", check.real_array(self.sink, "Correspondence3D.sink", ((3, 3),)))
        put(self, "probability", check.real(self.probability, "Correspondence3D.probability"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMap3D(CorrespondenceMap3DExt):
    """Pairs of points in two clouds.

    Attributes
    ----------
    items : tuple[Correspondence3D, ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMap3D"
    items: tuple[Correspondence3D, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(
                self.items, "CorrespondenceMap3D.items", 0, 1048576, lambda v, w: check.instance(v, w, Correspondence3D)
            ),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeature2D(Message):
    """What a ``VisualPointFeature2D`` of the ASN.1 modules holds.

    Attributes
    ----------
    point : NDArray[np.float64], shape (2,)
        px.
    descriptor : NDArray[np.float64], shape (0..128,)
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeature2D"
    point: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))
    descriptor: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "point", check.real_array(self.point, "VisualPointFeature2D.point", ((2, 2),)))
        put(self, "descriptor", check.real_array(self.descriptor, "VisualPointFeature2D.descriptor", ((0, 128),)))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeatureVector2D(VisualPointFeatureVector2DExt):
    """Points of an image with descriptors.

    Attributes
    ----------
    items : tuple[VisualPointFeature2D, ...]
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeatureVector2D"
    items: tuple[VisualPointFeature2D, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(
                self.items,
                "VisualPointFeatureVector2D.items",
                0,
                1048576,
                lambda v, w: check.instance(v, w, VisualPointFeature2D),
            ),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Point3DReference(Message):
    """A point by its number in a cloud.

    Attributes
    ----------
    point_cloud_identifier : int, 0..65535
    index : int, 0..9223372036854775807
    """

    ASN1_NAME: ClassVar[str] = "Point3DReference"
    point_cloud_identifier: int = 0
    index: int = 0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "point_cloud_identifier",
            check.integer(self.point_cloud_identifier, "Point3DReference.point_cloud_identifier", 0, 65535),
        )
        put(self, "index", check.integer(self.index, "Point3DReference.index", 0, 9223372036854775807))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeature3DPoint(Message):
    """The point of a VisualPointFeature3D: one of several kinds.

    Attributes
    ----------
    kind : str
        Which alternative: ``position``, ``reference``.
    value : NDArray[np.float64] | Point3DReference
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeature3D-point"
    kind: str = "position"
    value: NDArray[np.float64] | Point3DReference = field(default_factory=lambda: np.zeros((3,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        if self.kind == "position":
            put(self, "value", check.real_array(self.value, "VisualPointFeature3DPoint.position", ((3, 3),)))
        elif self.kind == "reference":
            put(self, "value", check.instance(self.value, "VisualPointFeature3DPoint.reference", Point3DReference))
        else:
            raise InputError(f"VisualPointFeature3DPoint.kind={self.kind!r}: expected one of position, reference")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VisualPointFeature3D(Message):
    """What a ``VisualPointFeature3D`` of the ASN.1 modules holds.

    Attributes
    ----------
    point : VisualPointFeature3DPoint
    descriptor : NDArray[np.float64], shape (0..352,)
    """

    ASN1_NAME: ClassVar[str] = "VisualPointFeature3D"
    point: VisualPointFeature3DPoint = field(default_factory=VisualPointFeature3DPoint)
    descriptor: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "point", check.instance(self.point, "VisualPointFeature3D.point", VisualPointFeature3DPoint))
        put(self, "descriptor", check.real_array(self.descriptor, "VisualPointFeature3D.descriptor", ((0, 352),)))


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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "list",
            check.items(
                self.list,
                "VisualPointFeatureVector3D.list",
                0,
                1048576,
                lambda v, w: check.instance(v, w, VisualPointFeature3D),
            ),
        )
        put(
            self,
            "list_type",
            check.enumeration(self.list_type, "VisualPointFeatureVector3D.list_type", VisualPointFeatureVector3DType),
        )
        put(
            self,
            "feature_type",
            check.enumeration(self.feature_type, "VisualPointFeatureVector3D.feature_type", VisualPointFeature3DType),
        )
        self._check_together()
