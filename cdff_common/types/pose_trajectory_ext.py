# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import pack_poses, pack_squares, stamps_us, unpack_poses
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points

if TYPE_CHECKING:
    from cdff_common.types.pose_trajectory import PoseTrajectory, PoseTrajectoryData, PoseTrajectoryMetadata


class PoseTrajectoryDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        stamps: NDArray[np.int64]
        poses: NDArray[np.float64]
        covariances: NDArray[np.float64]

    def _check_together(self) -> None:
        """One pose for each stamp, rising stamps; covariances none, or one for each pose."""
        n = len(self.stamps)
        if len(self.poses) != n or len(self.covariances) not in (0, n):
            raise InputError(
                f"PoseTrajectoryData: {n} stamps, {len(self.poses)} poses, {len(self.covariances)} covariances: "
                "expected as many (covariances may be none)"
            )
        if n > 1 and not (np.diff(self.stamps) > 0).all():
            raise InputError("PoseTrajectoryData.stamps: expected rising stamps")


class PoseTrajectoryExt(Message):
    """``T_parent_child`` at rising times."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: PoseTrajectoryMetadata
        data: PoseTrajectoryData

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
    ) -> PoseTrajectory:
        """Trajectory of ``T_parent_child``.

        Parameters
        ----------
        stamps_ns : array_like of int, shape (n,)
            Rising, multiples of 1000.
        matrices : array_like, shape (n, 4, 4)
            Metres.
        covariances : array_like, shape (n, 6, 6), optional
            Order x y z rx ry rz, in the parent; NaN where unknown.

        Raises
        ------
        InputError
            On sizes that differ, stamps that do not rise, or matrices that are not rigid.
        """
        from cdff_common.types.pose_trajectory import PoseTrajectory, PoseTrajectoryData, PoseTrajectoryMetadata

        stamps = stamps_us(stamps_ns, "PoseTrajectory stamps")
        poses = pack_poses(matrices, "PoseTrajectory")
        packed = pack_squares(covariances, len(poses), 6, "PoseTrajectory covariances")
        metadata = PoseTrajectoryMetadata(producer_id=producer, parent_frame_id=parent, child_frame_id=child)
        return PoseTrajectory(metadata, PoseTrajectoryData(stamps, poses, packed))

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
        """Covariances ``(n, 6, 6)``; None where it has none."""
        return self.data.covariances.reshape(-1, 6, 6) if len(self.data.covariances) else None

    @property
    def parent_frame(self) -> str:
        """The frame in which."""
        return self.metadata.parent_frame_id

    @property
    def child_frame(self) -> str:
        """The frame of which."""
        return self.metadata.child_frame_id

    @property
    def stamp_ns(self) -> int:
        """Time of the last pose, nanoseconds; raises InputError where there is none."""
        if not len(self.data.stamps):
            raise InputError("PoseTrajectory: no poses, so no stamp")
        return int(self.data.stamps[-1]) * 1000

    def extent_m(self) -> Box | None:
        """Box around the positions in the parent."""
        return box_of_points(self.data.poses[:, :3])
