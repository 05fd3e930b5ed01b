# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/sequences.asn by cdff generate; do not edit.

"""Types of ``asn1/sequences.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.features import Correspondence2D, Correspondence3D
from cdff_common.types.frame import Frame
from cdff_common.types.message import Message
from cdff_common.types.pose import Pose


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FramesSequence(Message):
    """Type ``FramesSequence`` of the ASN.1 modules.

    Attributes
    ----------
    items : tuple[Frame, ...]
    """

    ASN1_NAME: ClassVar[str] = "FramesSequence"
    items: tuple[Frame, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PosesSequence(Message):
    """Type ``PosesSequence`` of the ASN.1 modules.

    Attributes
    ----------
    items : tuple[Pose, ...]
    """

    ASN1_NAME: ClassVar[str] = "PosesSequence"
    items: tuple[Pose, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMaps2DSequence(Message):
    """Type ``CorrespondenceMaps2DSequence`` of the ASN.1 modules.

    Attributes
    ----------
    items : tuple[tuple[Correspondence2D, ...], ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMaps2DSequence"
    items: tuple[tuple[Correspondence2D, ...], ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorrespondenceMaps3DSequence(Message):
    """Type ``CorrespondenceMaps3DSequence`` of the ASN.1 modules.

    Attributes
    ----------
    items : tuple[tuple[Correspondence3D, ...], ...]
    """

    ASN1_NAME: ClassVar[str] = "CorrespondenceMaps3DSequence"
    items: tuple[tuple[Correspondence3D, ...], ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointSequence(Message):
    """Type ``PointSequence`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (0..16777216, 3)
    """

    ASN1_NAME: ClassVar[str] = "PointSequence"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DoubleSequence(Message):
    """Type ``DoubleSequence`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (0..16777216,)
    """

    ASN1_NAME: ClassVar[str] = "DoubleSequence"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StringSequence(Message):
    """Type ``StringSequence`` of the ASN.1 modules.

    Attributes
    ----------
    items : tuple[str, ...]
    """

    ASN1_NAME: ClassVar[str] = "StringSequence"
    items: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VectorXdSequence(Message):
    """Type ``VectorXdSequence`` of the ASN.1 modules.

    Attributes
    ----------
    items : tuple[NDArray[np.float64], ...]
    """

    ASN1_NAME: ClassVar[str] = "VectorXdSequence"
    items: tuple[NDArray[np.float64], ...] = ()
