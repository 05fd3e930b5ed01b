# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each point by the pose interpolated to its own time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import ExtrapolationError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_deskewing._interface import (
    PointCloudDeskewingInputs,
    PointCloudDeskewingInterface,
    PointCloudDeskewingOutputs,
)
from cdff_core.dfns.point_cloud_deskewing._kernels import deskew


class PoseInterpolationConfig(DfnConfig):
    """How far apart poses may be."""

    max_gap_s: float = Field(1.0, gt=0.0, le=1e6, description="Longest time between two poses interpolated, seconds")


class PoseInterpolation(PointCloudDeskewingInterface):
    """Translation linearly, rotation along the geodesic, as ``cdff_common.geometry.interpolate`` does.

    The pose's error at neighbouring times is taken as one and the same (covariance interpolated linearly). That of
    z alone is carried on: an error in x or y moves a height to a neighbouring cell, which the spread in the cell shows.
    """

    Config: ClassVar[type[DfnConfig]] = PoseInterpolationConfig

    def setup(self) -> None:
        """Compile, so that the first sweep is as fast as the others."""
        zero, eye = np.zeros((1, 3)), np.broadcast_to(np.eye(3), (2, 3, 3)).copy()
        deskew(zero, np.zeros(1, np.int64), np.zeros(1), eye, np.zeros((2, 3)), zero, np.zeros((2, 6, 6)))

    def process(self, inputs: PointCloudDeskewingInputs) -> PointCloudDeskewingOutputs:
        """Return the points in the trajectory's parent frame.

        Raises
        ------
        InputError
            If there are no poses, or not one stamp for each point.
        ExtrapolationError
            If a stamp lies outside the trajectory, or in a gap longer than ``max_gap_s``.
        """
        points = checked_points(inputs.points, least=0, finite=False)
        stamps = np.asarray(inputs.stamps_ns, dtype=np.int64)
        knots = inputs.trajectory.stamps_ns
        if stamps.shape != (len(points),) or len(knots) == 0:
            raise InputError(f"{len(points)} points, stamps {stamps.shape}, {len(knots)} poses: expected a stamp each")
        if len(points) == 0:
            return PointCloudDeskewingOutputs(points=np.empty((0, 3)), height_variance=np.empty(0))
        if stamps.min() < knots[0] or stamps.max() > knots[-1]:
            raise ExtrapolationError(
                f"points from {stamps.min()} to {stamps.max()}, poses from {knots[0]} to {knots[-1]}: "
                "expected poses that enclose the points"
            )
        T, C = inputs.trajectory.matrices, inputs.trajectory.covariances
        if len(knots) == 1:  # all points at the one pose's stamp
            knots, T = np.repeat(knots, 2), np.repeat(T, 2, axis=0)
            C = None if C is None else np.repeat(C, 2, axis=0)
        interval = np.clip(np.searchsorted(knots, stamps, side="right") - 1, 0, len(knots) - 2)
        length_ns = np.diff(knots)
        exact = stamps == knots[interval]
        too_long = (length_ns[interval] > self.config.max_gap_s * 1e9) & ~exact & (stamps != knots[interval + 1])
        if np.any(too_long):
            gap_s = length_ns[interval][too_long].max() / 1e9
            raise ExtrapolationError(f"poses {gap_s:.3f} s apart: expected at most {self.config.max_gap_s} s")
        fraction = np.where(exact, 0.0, (stamps - knots[interval]) / np.maximum(length_ns[interval], 1))
        R = np.ascontiguousarray(T[:, :3, :3])
        phi = np.ascontiguousarray(se3.log_so3(np.swapaxes(R[:-1], 1, 2) @ R[1:]))
        covariance = np.full((len(knots), 6, 6), np.nan) if C is None else np.array(C, dtype=np.float64)
        moved, variance = deskew(
            points, interval.astype(np.int64), fraction, R, np.ascontiguousarray(T[:, :3, 3]), phi, covariance
        )
        return PointCloudDeskewingOutputs(points=moved, height_variance=variance)
