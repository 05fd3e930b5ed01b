# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a bundle: cameras, lenses, points and observations."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.columns import pack_poses, stamps_us, unpack_poses
from cdff_common.types.message import Message

#: Adjustable parameters of a lens.
FOCAL, PRINCIPAL_POINT, K1, K2, K3, TANGENTIAL = 1, 2, 4, 8, 16, 32


class BundleCamerasExt(Message):
    """One row per camera."""

    __slots__ = ()
    poses: NDArray[np.float64]

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_frame_camera (n, 4, 4)``."""
        return unpack_poses(self.poses, "BundleCameras")


class BundlePriorExt(Message):
    """One pose per camera, and 6k x 6k and 6k numbers."""

    __slots__ = ()
    cameras: NDArray[np.int64]
    poses: NDArray[np.float64]
    information: NDArray[np.float64]
    gradient: NDArray[np.float64]

    def _check_consistency(self) -> None:
        """Check the columns, and the size of the information matrix and of the gradient."""
        Message._check_consistency(self)
        k = len(self.cameras)
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
        """Linearisation poses ``T_frame_camera (k, 4, 4)``."""
        return unpack_poses(self.poses, "BundlePrior")


class BundleProblemExt(Message):
    """Cameras, lenses, points and observations."""

    __slots__ = ()
    metadata: types.BundleMetadata
    cameras: types.BundleCameras
    lenses: types.BundleLenses
    points: types.BundlePoints
    observations: types.BundleObservations
    prior: types.BundlePrior

    def _check_consistency(self) -> None:
        """Check that referenced rows and the cameras of the prior exist."""
        references = (
            ("cameras.lenses", self.cameras.lenses, len(self.lenses.values)),
            ("observations.cameras", self.observations.cameras, len(self.cameras.ids)),
            ("observations.points", self.observations.points, len(self.points.ids)),
        )
        for column, rows, count in references:
            if len(rows) and int(rows.max()) >= count:
                raise InputError(f"BundleProblem.{column}: row {rows.max()}, expected below {count}")
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
        prior: types.BundlePrior | None = None,
        producer: str = "",
    ) -> types.BundleProblem:
        """Return the problem of ``n`` cameras, ``l`` lenses, ``p`` points and ``m`` observations.

        Parameters
        ----------
        matrices : array_like, shape (n, 4, 4)
            ``T_frame_camera``, metres; camera x right, y down, z forward.
        lenses : array_like, shape (l, 4..10)
            fx fy cx cy, then k1 k2 p1 p2 k3 and the baseline; missing parameters are 0.
        positions_m : array_like, shape (p, 3)
        observed : tuple of array_like of int, shape (m,)
            Rows of the camera and of the point.
        pixels : array_like, shape (m, 2) or (m, 3)
            Column and row, and for a rectified pair the column in the right image, NaN if it is missing.
        lens_of_camera : array_like of int, shape (n,), optional
            Row of the lens of each camera; by default the first.
        free, fixed, fixed_points : array_like
            Columns as in the message, or one value for all.

        Raises
        ------
        InputError
            If array lengths differ, or a row refers to a missing camera, lens or point.
        """
        T = np.asarray(matrices, dtype=np.float64).reshape(-1, 4, 4)
        points = np.asarray(positions_m, dtype=np.float64).reshape(-1, 3)
        n, p = len(T), len(points)
        stamps = np.zeros(n, np.int64) if stamps_ns is None else stamps_us(stamps_ns, "BundleProblem stamps")
        lens_rows = np.atleast_2d(np.asarray(lenses, dtype=np.float64))
        observed_px = np.atleast_2d(np.asarray(pixels, dtype=np.float64))
        if lens_rows.shape[1] > 10 or observed_px.shape[1] not in (2, 3):
            raise InputError(
                f"lenses {lens_rows.shape}, pixels {observed_px.shape}: expected (l, 4..10), (m, 2 or 3)"
            )
        values = np.zeros((len(lens_rows), 10))
        values[:, : lens_rows.shape[1]] = lens_rows
        if observed_px.shape[1] == 2:
            observed_px = np.column_stack([observed_px, np.full(len(observed_px), np.nan)])
        cameras = types.BundleCameras(
            np.arange(n) if ids is None else np.asarray(ids, np.int64),
            stamps,
            pack_poses(T, "BundleProblem camera"),
            np.zeros(n, np.uint32)
            if lens_of_camera is None
            else np.asarray(lens_of_camera).astype(np.uint32),
            np.broadcast_to(np.asarray(fixed), n).astype(np.uint8),
        )
        metadata = types.BundleMetadata(
            producer_id=producer,
            frame_id=frame,
            time_stamp=types.Time(int(stamps.max())) if n else types.Time(),
        )
        return types.BundleProblem(
            metadata,
            cameras,
            types.BundleLenses(values, np.broadcast_to(np.asarray(free), len(values)).astype(np.uint32)),
            types.BundlePoints(
                np.arange(p) if point_ids is None else np.asarray(point_ids, np.int64),
                points,
                np.broadcast_to(np.asarray(fixed_points), p).astype(np.uint8),
            ),
            types.BundleObservations(
                np.asarray(observed[0]).astype(np.uint32),
                np.asarray(observed[1]).astype(np.uint32),
                observed_px,
            ),
            types.BundlePrior() if prior is None else prior,
        )
