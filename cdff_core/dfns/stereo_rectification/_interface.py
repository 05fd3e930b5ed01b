# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoRectification."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import FramePair


@dataclass(frozen=True, slots=True, eq=False)
class StereoRectificationInputs:
    """Inputs of one call.

    Attributes
    ----------
    pair : FramePair
        Images of one size, each with its camera and with where it sits on the robot (extrinsic).
    """

    pair: FramePair


@dataclass(frozen=True, slots=True, eq=False)
class StereoRectificationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pair : FramePair
        Same size, depth and stamps; one camera matrix, baseline in metres; a point lies on the same row in both,
        disparity 0 is at infinity; the frames are called {frame}_rectified.
    """

    pair: FramePair


class StereoRectificationInterface(Dfn[Any, StereoRectificationInputs, StereoRectificationOutputs]):
    """A stereo pair as two equal cameras without distortion would have taken it, the right one straight to the right
    of the left one.
    """
