# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of lists of poses and points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.pose_ext import box_of_boxes

if TYPE_CHECKING:
    from cdff_common.types.pose import Pose


class PosesSequenceExt(Message):
    """Poses of one frame."""

    __slots__ = ()
    if TYPE_CHECKING:
        items: tuple[Pose, ...]

    def extent_m(self) -> Box | None:
        """Box around the positions."""
        return box_of_boxes(pose.extent_m() for pose in self.items)


class PointSequenceExt(Message):
    """Points of one frame."""

    __slots__ = ()
    if TYPE_CHECKING:
        values: NDArray[np.float64]

    def extent_m(self) -> Box | None:
        """Box around the finite points."""
        return box_of_points(self.values)
