# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudDeskewing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import PoseTrajectory


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudDeskewingInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        In the trajectory's child frame, each at its own time, metres.
    stamps_ns : ndarray of int64, shape (n)
        When each point was measured, nanoseconds.
    trajectory : PoseTrajectory
        T_fixed_body at rising times that enclose the stamps.
    """

    points: NDArray[np.float64]
    stamps_ns: NDArray[np.int64]
    trajectory: PoseTrajectory


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudDeskewingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        In the trajectory's parent frame, metres.
    height_variance : ndarray of float64, shape (n)
        Variance that the covariance of the poses puts on each z, square metres; NaN where that is unknown.
    """

    points: NDArray[np.float64]
    height_variance: NDArray[np.float64]


class PointCloudDeskewingInterface(Dfn[Any, PointCloudDeskewingInputs, PointCloudDeskewingOutputs]):
    """Points measured one by one from a moving body, brought into the fixed frame by the body's pose at each point's
    own time.
    """
