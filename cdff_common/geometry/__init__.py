# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The only SE(3) algebra, covariance propagation, interpolation and frame tree of the framework."""

from cdff_common.geometry.frame_graph import FrameGraph, PoseTrack, checked_frame
from cdff_common.geometry.uncertain import UncertainTransform, interpolate

__all__ = ["FrameGraph", "PoseTrack", "UncertainTransform", "checked_frame", "interpolate"]
