# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/bundle.asn by cdff generate; do not edit.

"""Types of ``asn1/bundle.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.bundle_ext import (
    BundleCamerasExt,
    BundleLensesExt,
    BundleObservationsExt,
    BundlePointsExt,
    BundlePriorExt,
    BundleProblemExt,
)
from cdff_common.types.message import Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleMetadata(Message):
    """What a ``Bundle-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame of poses and points.
    time_stamp : Time
        of the newest image.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "BundleMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "BundleMetadata.producer_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "BundleMetadata.frame_id", 256))
        put(self, "time_stamp", check.instance(self.time_stamp, "BundleMetadata.time_stamp", Time))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleCameras(BundleCamerasExt):
    """Columns of one length: one row for each image.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        each once.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_camera: x y z (m), qx qy qz qw; camera x right, y down, z forward.
    lenses : NDArray[np.uint32], shape (n,)
        row of the lens it was taken with.
    fixed : NDArray[np.uint8], shape (n,)
        1 where the pose may not be moved.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Cameras"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    lenses: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    fixed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ids", check.typed_octets(self.ids, "BundleCameras.ids", 1073741824, "<i8", 0))
        put(self, "stamps", check.typed_octets(self.stamps, "BundleCameras.stamps", 1073741824, "<i8", 0))
        put(self, "poses", check.typed_octets(self.poses, "BundleCameras.poses", 1073741824, "<f8", 7))
        put(self, "lenses", check.typed_octets(self.lenses, "BundleCameras.lenses", 1073741824, "<u4", 0))
        put(self, "fixed", check.typed_octets(self.fixed, "BundleCameras.fixed", 1073741824, "<u1", 0))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleLenses(BundleLensesExt):
    """Columns of one length: one row for each lens.

    Attributes
    ----------
    values : NDArray[np.float64], shape (n, 10)
        fx fy cx cy (px), k1 k2 p1 p2 k3 (OpenCV's order), baseline of a rectified pair (m), 0 without.
    free : NDArray[np.uint32], shape (n,)
        what may be adjusted, a sum: 1 fx and fy in proportion, 2 cx cy, 4 k1, 8 k2, 16 k3, 32 p1 p2.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Lenses"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 10), np.float64))
    free: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "values", check.typed_octets(self.values, "BundleLenses.values", 1073741824, "<f8", 10))
        put(self, "free", check.typed_octets(self.free, "BundleLenses.free", 1073741824, "<u4", 0))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundlePoints(BundlePointsExt):
    """Columns of one length: one row for each point.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        each once.
    positions : NDArray[np.float64], shape (n, 3)
        m, x y z.
    fixed : NDArray[np.uint8], shape (n,)
        1 where the point may not be moved.
    """

    ASN1_NAME: ClassVar[str] = "Bundle-Points"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    fixed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ids", check.typed_octets(self.ids, "BundlePoints.ids", 1073741824, "<i8", 0))
        put(self, "positions", check.typed_octets(self.positions, "BundlePoints.positions", 1073741824, "<f8", 3))
        put(self, "fixed", check.typed_octets(self.fixed, "BundlePoints.fixed", 1073741824, "<u1", 0))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleObservations(BundleObservationsExt):
    """Columns of one length: one row for each point in an image.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "cameras", check.typed_octets(self.cameras, "BundleObservations.cameras", 1073741824, "<u4", 0))
        put(self, "points", check.typed_octets(self.points, "BundleObservations.points", 1073741824, "<u4", 0))
        put(self, "pixels", check.typed_octets(self.pixels, "BundleObservations.pixels", 1073741824, "<f8", 3))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundlePrior(BundlePriorExt):
    """What is known of poses beforehand, as from images that were dropped: (1/2) d' H d + b' d with d from these
    poses.

    Attributes
    ----------
    cameras : NDArray[np.int64], shape (n,)
        ids of the cameras.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_camera from which d is counted.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "cameras", check.typed_octets(self.cameras, "BundlePrior.cameras", 1073741824, "<i8", 0))
        put(self, "poses", check.typed_octets(self.poses, "BundlePrior.poses", 1073741824, "<f8", 7))
        put(self, "information", check.typed_octets(self.information, "BundlePrior.information", 1073741824, "<f8", 0))
        put(self, "gradient", check.typed_octets(self.gradient, "BundlePrior.gradient", 1073741824, "<f8", 0))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BundleProblem(BundleProblemExt):
    """What a ``BundleProblem`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "BundleProblem.metadata", BundleMetadata))
        put(self, "cameras", check.instance(self.cameras, "BundleProblem.cameras", BundleCameras))
        put(self, "lenses", check.instance(self.lenses, "BundleProblem.lenses", BundleLenses))
        put(self, "points", check.instance(self.points, "BundleProblem.points", BundlePoints))
        put(self, "observations", check.instance(self.observations, "BundleProblem.observations", BundleObservations))
        put(self, "prior", check.instance(self.prior, "BundleProblem.prior", BundlePrior))
        self._check_together()
