# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoRectification."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import FramePair


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoRectificationInputs:
    """Inputs of one call.

    Attributes
    ----------
    pair : FramePair
        Images of the same size, each with its camera and its pose on the robot (extrinsic).
    """

    pair: FramePair


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoRectificationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pair : FramePair
        Pair with the same size, depth and stamps and its baseline in metres; both images have the same
        camera matrix; a point is on the same row in both images, and points at infinity have disparity 0;
        the frames are named {frame}_rectified.
    """

    pair: FramePair


class StereoRectificationInterface(Dfn[ConfigT, StereoRectificationInputs, StereoRectificationOutputs]):
    """Rectify a stereo pair: resample it to two equal cameras without distortion; the right camera is
    displaced along the x axis of the left camera.
    """


#: Short names for the implementations.
Inputs = StereoRectificationInputs
Outputs = StereoRectificationOutputs
Interface = StereoRectificationInterface
