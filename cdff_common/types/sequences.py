# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/sequences.asn by cdff generate; do not edit.

"""Types of ``asn1/sequences.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.features import Correspondence2D, Correspondence3D
from cdff_common.types.frame import Frame
from cdff_common.types.message import Message
from cdff_common.types.pose import Pose
from cdff_common.types.sequences_ext import PointSequenceExt, PosesSequenceExt


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FramesSequence(Message):
    """What a ``FramesSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    items : tuple[Frame, ...]
    """

    ASN1_NAME: ClassVar[str] = "FramesSequence"
    items: tuple[Frame, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(self.items, "FramesSequence.items", 0, 1024, lambda v, w: check.instance(v, w, Frame)),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PosesSequence(PosesSequenceExt):
    """What a ``PosesSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    items : tuple[Pose, ...]
    """

    ASN1_NAME: ClassVar[str] = "PosesSequence"
    items: tuple[Pose, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(self.items, "PosesSequence.items", 0, 1048576, lambda v, w: check.instance(v, w, Pose)),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMaps2DSequence(Message):
    """What a ``CorrespondenceMaps2DSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    items : tuple[tuple[Correspondence2D, ...], ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMaps2DSequence"
    items: tuple[tuple[Correspondence2D, ...], ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(
                self.items,
                "CorrespondenceMaps2DSequence.items",
                0,
                16384,
                lambda v, w: check.items(v, w, 0, 1048576, lambda v, w: check.instance(v, w, Correspondence2D)),
            ),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMaps3DSequence(Message):
    """What a ``CorrespondenceMaps3DSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    items : tuple[tuple[Correspondence3D, ...], ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMaps3DSequence"
    items: tuple[tuple[Correspondence3D, ...], ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(
                self.items,
                "CorrespondenceMaps3DSequence.items",
                0,
                16384,
                lambda v, w: check.items(v, w, 0, 1048576, lambda v, w: check.instance(v, w, Correspondence3D)),
            ),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointSequence(PointSequenceExt):
    """What a ``PointSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    values : NDArray[np.float64], shape (0..16777216, 3)
    """

    ASN1_NAME: ClassVar[str] = "PointSequence"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "values", check.real_array(self.values, "PointSequence.values", ((0, 16777216), (3, 3))))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DoubleSequence(Message):
    """What a ``DoubleSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    values : NDArray[np.float64], shape (0..16777216,)
    """

    ASN1_NAME: ClassVar[str] = "DoubleSequence"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "values", check.real_array(self.values, "DoubleSequence.values", ((0, 16777216),)))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StringSequence(Message):
    """What a ``StringSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    items : tuple[str, ...]
    """

    ASN1_NAME: ClassVar[str] = "StringSequence"
    items: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self, "items", check.items(self.items, "StringSequence.items", 0, 65536, lambda v, w: check.text(v, w, 256))
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VectorXdSequence(Message):
    """What a ``VectorXdSequence`` of the ASN.1 modules holds.

    Attributes
    ----------
    items : tuple[NDArray[np.float64], ...]
    """

    ASN1_NAME: ClassVar[str] = "VectorXdSequence"
    items: tuple[NDArray[np.float64], ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "items",
            check.items(
                self.items, "VectorXdSequence.items", 0, 16777216, lambda v, w: check.real_array(v, w, ((0, 100),))
            ),
        )
