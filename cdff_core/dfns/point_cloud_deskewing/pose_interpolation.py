# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Deskewing with the pose interpolated to the time of each point."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import ExtrapolationError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_deskewing._kernels import deskew
from cdff_core.dfns.point_cloud_deskewing.interface import Inputs, Interface, Outputs


class PoseInterpolationConfig(DfnConfig):
    """Parameters of PoseInterpolation."""

    max_gap_s: float = Field(
        1.0, gt=0, le=1e6, description="Longest interval between poses that is interpolated"
    )


class PoseInterpolation(Interface[PoseInterpolationConfig]):
    """Transform each point by a pose with linearly interpolated translation and geodesically interpolated
    rotation.

    Errors of neighbouring poses are treated as fully correlated: the covariance is interpolated linearly.
    Only the variance of z is propagated: an error in x or y moves a height to a neighbouring cell of a map,
    where it increases the variance of the heights.
    """

    def setup(self) -> None:
        """Compile the kernel."""
        zero, eye = np.zeros((1, 3)), np.broadcast_to(np.eye(3), (2, 3, 3)).copy()
        deskew(zero, np.zeros(1, np.int64), np.zeros(1), eye, np.zeros((2, 3)), zero, np.zeros((2, 6, 6)))

    def process(self, inputs: Inputs) -> Outputs:
        """Return the points in the fixed frame.

        Raises
        ------
        InputError
            If there are no poses.
        ExtrapolationError
            If a stamp lies outside the stamps of the poses, or in a gap longer than ``max_gap_s``.
        """
        points = checked_points(inputs.points, least=0, finite=False)
        stamps = np.asarray(inputs.stamps_ns, dtype=np.int64)
        pose_ns, T, C = inputs.pose_stamps_ns, inputs.poses, inputs.pose_covariances
        if len(pose_ns) == 0:
            raise InputError("poses: none, expected at least one")
        if len(points) == 0:
            return Outputs(points=np.empty((0, 3)), height_variance=np.empty(0))
        if stamps.min() < pose_ns[0] or stamps.max() > pose_ns[-1]:
            raise ExtrapolationError(
                f"points from {stamps.min()} to {stamps.max()}, poses from {pose_ns[0]} to {pose_ns[-1]}: "
                "expected poses that enclose the points"
            )
        if len(pose_ns) == 1:  # all points have the time of this pose
            pose_ns, T = np.repeat(pose_ns, 2), np.repeat(T, 2, axis=0)
            C = None if C is None else np.repeat(C, 2, axis=0)
        interval = np.clip(np.searchsorted(pose_ns, stamps, side="right") - 1, 0, len(pose_ns) - 2)
        length_ns = np.diff(pose_ns)
        at_pose = stamps == pose_ns[interval]
        too_long = (
            (length_ns[interval] > self.config.max_gap_s * 1e9) & ~at_pose & (stamps != pose_ns[interval + 1])
        )
        if np.any(too_long):
            gap_s = length_ns[interval][too_long].max() / 1e9
            raise ExtrapolationError(
                f"poses {gap_s:.3f} s apart: expected at most {self.config.max_gap_s:g} s"
            )
        fraction = np.where(at_pose, 0.0, (stamps - pose_ns[interval]) / np.maximum(length_ns[interval], 1))
        R = np.ascontiguousarray(T[:, :3, :3])
        phi = np.ascontiguousarray(se3.log_so3(np.swapaxes(R[:-1], 1, 2) @ R[1:]))
        covariance = np.full((len(pose_ns), 6, 6), np.nan) if C is None else np.array(C, dtype=np.float64)
        fixed, variance = deskew(
            points, interval.astype(np.int64), fraction, R, np.ascontiguousarray(T[:, :3, 3]), phi, covariance
        )
        return Outputs(points=fixed, height_variance=variance)
