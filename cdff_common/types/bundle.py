# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/bundle.asn by cdff generate; do not edit.

"""Types of ``asn1/bundle.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.bundle_ext import BundleCamerasExt, BundlePriorExt, BundleProblemExt
from cdff_common.types.message import FramedMessage, Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleMetadata(Message):
    """Type ``Bundle-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of poses and points.
    time_stamp : Time
        of the newest image.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleCameras(BundleCamerasExt):
    """Cameras, as columns of equal length: one row per image.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        unique.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_camera: x y z (m), qx qy qz qw; camera x right, y down, z forward.
    lenses : NDArray[np.uint32], shape (n,)
        row of the lens.
    fixed : NDArray[np.uint8], shape (n,)
        1 for a pose that is not adjusted.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Cameras"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    lenses: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    fixed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleLenses(Message):
    """Lenses, as columns of equal length: one row per lens.

    Attributes
    ----------
    values : NDArray[np.float64], shape (n, 10)
        fx fy cx cy (px), k1 k2 p1 p2 k3 (OpenCV's order), baseline of a rectified pair (m) or 0.
    free : NDArray[np.uint32], shape (n,)
        adjusted, a sum of: 1 fx and fy in proportion, 2 cx cy, 4 k1, 8 k2, 16 k3, 32 p1 p2.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Lenses"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 10), np.float64))
    free: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundlePoints(Message):
    """Points, as columns of equal length: one row per point.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        unique.
    positions : NDArray[np.float64], shape (n, 3)
        m, x y z.
    fixed : NDArray[np.uint8], shape (n,)
        1 for a point that is not adjusted.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Points"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    fixed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleObservations(Message):
    """Observations, as columns of equal length: one row per point in an image.

    Attributes
    ----------
    cameras : NDArray[np.uint32], shape (n,)
        row of the camera.
    points : NDArray[np.uint32], shape (n,)
        row of the point.
    pixels : NDArray[np.float64], shape (n, 3)
        px: column, row, column in the right image of a rectified pair, NaN without.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Observations"
    cameras: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    points: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    pixels: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundlePrior(BundlePriorExt):
    """Prior on poses, e.g. from marginalised images: (1/2) d' H d + b' d with the deviation d from these
    poses.

    Attributes
    ----------
    cameras : NDArray[np.int64], shape (n,)
        ids of the cameras.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_camera, origin of d.
    information : NDArray[np.float64], shape (n,)
        H, 6k x 6k rows: x y z rx ry rz of each camera, error in frame (1/m2, 1/rad2).
    gradient : NDArray[np.float64], shape (n,)
        b, 6k.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Prior"
    cameras: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    information: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0, np.float64))
    gradient: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0, np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleProblem(BundleProblemExt, FramedMessage):
    """Type ``BundleProblem`` of the ASN.1 modules.

    Attributes
    ----------
    metadata : BundleMetadata
    cameras : BundleCameras
    lenses : BundleLenses
    points : BundlePoints
    observations : BundleObservations
    prior : BundlePrior
    """

    ASN1_NAME: ClassVar[str] = "BundleProblem"
    metadata: BundleMetadata = field(default_factory=BundleMetadata)
    cameras: BundleCameras = field(default_factory=BundleCameras)
    lenses: BundleLenses = field(default_factory=BundleLenses)
    points: BundlePoints = field(default_factory=BundlePoints)
    observations: BundleObservations = field(default_factory=BundleObservations)
    prior: BundlePrior = field(default_factory=BundlePrior)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns
