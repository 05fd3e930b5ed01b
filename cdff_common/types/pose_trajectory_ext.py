# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.columns import pack_poses, pack_squares, stamps_us, unpack_poses
from cdff_common.types.message import Message


class PoseTrajectoryExt(Message):
    """Poses ``T_parent_child`` in ascending order of time."""

    __slots__ = ()
    metadata: types.PoseTrajectoryMetadata
    data: types.PoseTrajectoryData

    @classmethod
    def from_arrays(
        cls,
        stamps_ns: ArrayLike,
        matrices: ArrayLike,
        covariances: ArrayLike | None = None,
        *,
        parent: str,
        child: str,
        producer: str = "",
    ) -> types.PoseTrajectory:
        """Return the trajectory of ``T_parent_child``.

        Parameters
        ----------
        stamps_ns : array_like of int, shape (n,)
            Ascending, multiples of 1000.
        matrices : array_like, shape (n, 4, 4)
            Metres.
        covariances : array_like, shape (n, 6, 6), optional
            Order x y z rx ry rz, in the parent; NaN where unknown.

        Raises
        ------
        InputError
            If array lengths differ, stamps do not ascend, or a matrix is not a rigid transform.
        """
        stamps = stamps_us(stamps_ns, "PoseTrajectory stamps")
        poses = pack_poses(matrices, "PoseTrajectory")
        packed = pack_squares(covariances, len(poses), 6, "PoseTrajectory covariances")
        metadata = types.PoseTrajectoryMetadata(
            producer_id=producer, parent_frame_id=parent, child_frame_id=child
        )
        return types.PoseTrajectory(metadata, types.PoseTrajectoryData(stamps, poses, packed))

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Times ``(n,)``, nanoseconds."""
        return self.data.stamps * 1000

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_parent_child (n, 4, 4)``; quaternions are normalised."""
        return unpack_poses(self.data.poses, "PoseTrajectory")

    @property
    def covariances(self) -> NDArray[np.float64] | None:
        """Covariances ``(n, 6, 6)``; None if the trajectory has none."""
        return self.data.covariances.reshape(-1, 6, 6) if len(self.data.covariances) else None

    @property
    def stamp_ns(self) -> int:
        """Time of the last pose, nanoseconds; raises InputError if there is none."""
        if not len(self.data.stamps):
            raise InputError("PoseTrajectory: no poses, so no stamp")
        return int(self.data.stamps[-1]) * 1000
