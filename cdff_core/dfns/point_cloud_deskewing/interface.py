# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudDeskewing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudDeskewingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points, each in the body frame at its time, metres.
    stamps_ns : ndarray of int64, shape (n)
        Measurement time of each point, nanoseconds.
    poses : ndarray of float64, shape (k,4,4)
        T_fixed_body at the pose stamps.
    pose_stamps_ns : ndarray of int64, shape (k)
        Ascending times of the poses, nanoseconds; they must enclose the stamps of the points.
    pose_covariances : ndarray of float64, shape (k,6,6), optional
        Covariances of the poses, [x y z rx ry rz], error in the fixed frame.
    """

    ARRAYS = ArrayPorts(
        {
            "points": "float64[n,3]",
            "stamps_ns": "int64[n]",
            "poses": "float64[k,4,4]",
            "pose_stamps_ns": "int64[k]",
            "pose_covariances": "float64[k,6,6]",
        },
        optional=["pose_covariances"],
    )

    points: NDArray[np.float64]
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    pose_stamps_ns: NDArray[np.int64]
    pose_covariances: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudDeskewingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the fixed frame, metres.
    height_variance : ndarray of float64, shape (n)
        Variance of each z due to the covariance of the poses, square metres; NaN if the covariance is
        unknown.
    """

    points: NDArray[np.float64]
    height_variance: NDArray[np.float64]


class PointCloudDeskewingInterface(Dfn[ConfigT, PointCloudDeskewingInputs, PointCloudDeskewingOutputs]):
    """Transform points measured one after another from a moving body into a fixed frame, each by the
    pose of the body at its time.
    """


#: Short names for the implementations.
Inputs = PointCloudDeskewingInputs
Outputs = PointCloudDeskewingOutputs
Interface = PointCloudDeskewingInterface
