# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a bundle: cameras, lenses, points, and where the points were seen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import check_columns, check_unique, pack_poses, stamps_us, unpack_poses
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.bundle import (
        BundleCameras,
        BundleLenses,
        BundleMetadata,
        BundleObservations,
        BundlePoints,
        BundlePrior,
        BundleProblem,
    )

#: What of a lens may be adjusted.
FOCAL, PRINCIPAL_POINT, K1, K2, K3, TANGENTIAL = 1, 2, 4, 8, 16, 32


class BundleCamerasExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        ids: NDArray[np.int64]
        stamps: NDArray[np.int64]
        poses: NDArray[np.float64]
        lenses: NDArray[np.uint32]
        fixed: NDArray[np.uint8]

    def _check_together(self) -> None:
        """One of each for each camera, and each camera once."""
        whole: dict[str, NDArray[Any]] = {
            "stamps": self.stamps,
            "poses": self.poses,
            "lenses": self.lenses,
            "fixed": self.fixed,
        }
        check_columns("BundleCameras", len(self.ids), whole, {})
        check_unique("BundleCameras.ids", self.ids)

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_frame_camera (n, 4, 4)``."""
        return unpack_poses(self.poses, "BundleCameras")


class BundleLensesExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        values: NDArray[np.float64]
        free: NDArray[np.uint32]

    def _check_together(self) -> None:
        """What is free of each lens."""
        check_columns("BundleLenses", len(self.values), {"free": self.free}, {})


class BundlePointsExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        ids: NDArray[np.int64]
        positions: NDArray[np.float64]
        fixed: NDArray[np.uint8]

    def _check_together(self) -> None:
        """One of each for each point, and each point once."""
        check_columns("BundlePoints", len(self.ids), {"positions": self.positions, "fixed": self.fixed}, {})
        check_unique("BundlePoints.ids", self.ids)


class BundleObservationsExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        cameras: NDArray[np.uint32]
        points: NDArray[np.uint32]
        pixels: NDArray[np.float64]

    def _check_together(self) -> None:
        """One of each for each observation."""
        check_columns("BundleObservations", len(self.cameras), {"points": self.points, "pixels": self.pixels}, {})


class BundlePriorExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        cameras: NDArray[np.int64]
        poses: NDArray[np.float64]
        information: NDArray[np.float64]
        gradient: NDArray[np.float64]

    def _check_together(self) -> None:
        """One pose for each camera, and 6k x 6k and 6k numbers."""
        k = len(self.cameras)
        check_columns("BundlePrior", k, {"poses": self.poses}, {})
        check_unique("BundlePrior.cameras", self.cameras)
        if len(self.information) != 36 * k * k or len(self.gradient) != 6 * k:
            text = f"{len(self.information)} and {len(self.gradient)} numbers"
            raise InputError(f"BundlePrior of {k} cameras: {text}, expected {36 * k * k} and {6 * k}")

    @property
    def matrix(self) -> NDArray[np.float64]:
        """``H (6k, 6k)``."""
        k = 6 * len(self.cameras)
        return self.information.reshape(k, k)

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_frame_camera (k, 4, 4)`` from which its d is counted."""
        return unpack_poses(self.poses, "BundlePrior")


class BundleProblemExt(Message):
    """Cameras, points and where the points were seen."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: BundleMetadata
        cameras: BundleCameras
        lenses: BundleLenses
        points: BundlePoints
        observations: BundleObservations
        prior: BundlePrior

    def _check_together(self) -> None:
        """Rows that are named are there; so are the prior's cameras."""
        named = (
            ("cameras.lenses", self.cameras.lenses, len(self.lenses.values)),
            ("observations.cameras", self.observations.cameras, len(self.cameras.ids)),
            ("observations.points", self.observations.points, len(self.points.ids)),
        )
        for where, rows, count in named:
            if len(rows) and int(rows.max()) >= count:
                raise InputError(f"BundleProblem.{where}: row {rows.max()}, there are {count}")
        missing = np.setdiff1d(self.prior.cameras, self.cameras.ids)
        if missing.size:
            raise InputError(f"BundleProblem.prior: camera {missing[0]} is not in the problem")

    @classmethod
    def from_arrays(
        cls,
        matrices: ArrayLike,
        lenses: ArrayLike,
        positions_m: ArrayLike,
        observed: tuple[ArrayLike, ArrayLike],
        pixels: ArrayLike,
        *,
        frame: str,
        stamps_ns: ArrayLike | None = None,
        lens_of_camera: ArrayLike | None = None,
        free: ArrayLike = 0,
        fixed: ArrayLike = 0,
        fixed_points: ArrayLike = 0,
        ids: ArrayLike | None = None,
        point_ids: ArrayLike | None = None,
        prior: BundlePrior | None = None,
        producer: str = "",
    ) -> BundleProblem:
        """Problem of ``n`` cameras, ``l`` lenses, ``p`` points and ``m`` observations.

        Parameters
        ----------
        matrices : array_like, shape (n, 4, 4)
            ``T_frame_camera``, metres; camera x right, y down, z forward.
        lenses : array_like, shape (l, 4..10)
            fx fy cx cy, then k1 k2 p1 p2 k3 and the baseline; what is left out is 0.
        positions_m : array_like, shape (p, 3)
        observed : tuple of array_like of int, shape (m,)
            Rows of the camera and of the point.
        pixels : array_like, shape (m, 2) or (m, 3)
            Column and row; column in the right image of a rectified pair, NaN without.
        lens_of_camera : array_like of int, shape (n,), optional
            By default the first lens for all.
        free, fixed, fixed_points : array_like
            As the wire's columns, or one for all.

        Raises
        ------
        InputError
            On sizes that differ and rows that are not there.
        """
        from cdff_common.types.bundle import (
            BundleCameras,
            BundleLenses,
            BundleMetadata,
            BundleObservations,
            BundlePoints,
            BundlePrior,
            BundleProblem,
        )

        T = np.asarray(matrices, dtype=np.float64).reshape(-1, 4, 4)
        points = np.asarray(positions_m, dtype=np.float64).reshape(-1, 3)
        n, p = len(T), len(points)
        stamps = np.zeros(n, np.int64) if stamps_ns is None else stamps_us(stamps_ns, "BundleProblem stamps")
        given = np.atleast_2d(np.asarray(lenses, dtype=np.float64))
        seen = np.atleast_2d(np.asarray(pixels, dtype=np.float64))
        if given.shape[1] > 10 or seen.shape[1] not in (2, 3):
            raise InputError(f"lenses {given.shape}, pixels {seen.shape}: expected (l, 4..10), (m, 2 or 3)")
        values = np.zeros((len(given), 10))
        values[:, : given.shape[1]] = given
        if seen.shape[1] == 2:
            seen = np.column_stack([seen, np.full(len(seen), np.nan)])
        cameras = BundleCameras(
            np.arange(n) if ids is None else np.asarray(ids, np.int64),
            stamps,
            pack_poses(T, "BundleProblem camera"),
            np.zeros(n, np.uint32) if lens_of_camera is None else np.asarray(lens_of_camera).astype(np.uint32),
            np.broadcast_to(np.asarray(fixed), n).astype(np.uint8),
        )
        metadata = BundleMetadata(
            producer_id=producer, frame_id=frame, time_stamp=Time(int(stamps.max())) if n else Time()
        )
        return BundleProblem(
            metadata,
            cameras,
            BundleLenses(values, np.broadcast_to(np.asarray(free), len(values)).astype(np.uint32)),
            BundlePoints(
                np.arange(p) if point_ids is None else np.asarray(point_ids, np.int64),
                points,
                np.broadcast_to(np.asarray(fixed_points), p).astype(np.uint8),
            ),
            BundleObservations(
                np.asarray(observed[0]).astype(np.uint32), np.asarray(observed[1]).astype(np.uint32), seen
            ),
            BundlePrior() if prior is None else prior,
        )

    @property
    def frame(self) -> str:
        """Frame of poses and points."""
        return self.metadata.frame_id

    @property
    def stamp_ns(self) -> int:
        """Time of the newest image, nanoseconds."""
        return self.metadata.time_stamp.ns

    def extent_m(self) -> Box | None:
        """Box around the finite points."""
        return box_of_points(self.points.positions)
