# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PerspectiveNPointSolving."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class PerspectiveNPointSolvingInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the reference frame, metres.
    projections : ndarray of float64, shape (n,2)
        Column and row at which they appear, pixels.
    camera_matrix : ndarray of float64, shape (3,3)
        Undistorted camera, pixels.
    guess : ndarray of float64, shape (4,4), optional
        T_camera_reference tried first.
    """

    points: NDArray[np.float64]
    projections: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    guess: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PerspectiveNPointSolvingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    camera : ndarray of float64, shape (4,4)
        T_camera_reference.
    inliers : ndarray of bool, shape (n)
        Points that appear where the pose says.
    """

    camera: NDArray[np.float64]
    inliers: NDArray[np.bool_]


class PerspectiveNPointSolvingInterface(Dfn[Any, PerspectiveNPointSolvingInputs, PerspectiveNPointSolvingOutputs]):
    """Find the pose of a camera from points in space and where they appear, some of them wrongly."""
