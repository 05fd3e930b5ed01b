# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DisparityToPointCloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DisparityToPointCloudInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    disparity : Frame
        Float32, px, NaN without a match, with the rectified camera matrix.
    baseline_m : float
        Distance from the left to the right camera, metres.
    left : Frame, optional
        Left image, for the intensity of the points.
    """

    ARRAYS = ArrayPorts({}, positive=["baseline_m"])

    disparity: Frame
    baseline_m: float
    left: Frame | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DisparityToPointCloudOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Metres in the left camera's frame: x right, y down, z forward.
    depth_sigma_m : ndarray of float64, shape (n)
        Standard deviation of each z due to the noise of its disparity, metres.
    scale_sigma : float
        Standard deviation of the relative error that all z have in common, due to the errors of focal
        length and baseline.
    intensity : ndarray of int32, shape (n)
        Grey value of each point; all 0 without the left image.
    """

    points: NDArray[np.float64]
    depth_sigma_m: NDArray[np.float64]
    scale_sigma: float
    intensity: NDArray[np.int32]


class DisparityToPointCloudInterface(Dfn[ConfigT, DisparityToPointCloudInputs, DisparityToPointCloudOutputs]):
    """Triangulate the points of a disparity image in the left camera's frame, with the standard
    deviation of their depth; uncertain points are removed.
    """


#: Short names for the implementations.
Inputs = DisparityToPointCloudInputs
Outputs = DisparityToPointCloudOutputs
Interface = DisparityToPointCloudInterface
