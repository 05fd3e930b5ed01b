# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SE(3) algebra, covariance propagation, interpolation and the frame tree: the only implementation."""

from cdff_common.geometry.frame_graph import FrameGraph, PoseTrack, checked_frame
from cdff_common.geometry.odometry_buffer import OdometryBuffer
from cdff_common.geometry.uncertain_transform import UncertainTransform, interpolate

__all__ = ["FrameGraph", "OdometryBuffer", "PoseTrack", "UncertainTransform", "checked_frame", "interpolate"]
