# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PerspectiveNPointSolving."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PerspectiveNPointSolvingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the reference frame, metres.
    projections : ndarray of float64, shape (n,2)
        Column and row of the projection of each point, pixels.
    camera_matrix : ndarray of float64, shape (3,3)
        Intrinsic matrix of the undistorted camera, pixels.
    guess : ndarray of float64, shape (4,4), optional
        T_camera_reference that is tested first.
    """

    ARRAYS = ArrayPorts(
        {
            "points": "float64[n,3]",
            "projections": "float64[n,2]",
            "camera_matrix": "float64[3,3]",
            "guess": "float64[4,4]",
        },
        optional=["guess"],
    )

    points: NDArray[np.float64]
    projections: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    guess: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PerspectiveNPointSolvingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    camera : ndarray of float64, shape (4,4)
        T_camera_reference.
    inliers : ndarray of bool, shape (n)
        Points with a projection consistent with the pose.
    """

    camera: NDArray[np.float64]
    inliers: NDArray[np.bool_]


class PerspectiveNPointSolvingInterface(
    Dfn[ConfigT, PerspectiveNPointSolvingInputs, PerspectiveNPointSolvingOutputs]
):
    """Estimate the pose of a camera from points in space and their projections; some of the pairs may
    be wrong.
    """


#: Short names for the implementations.
Inputs = PerspectiveNPointSolvingInputs
Outputs = PerspectiveNPointSolvingOutputs
Interface = PerspectiveNPointSolvingInterface
