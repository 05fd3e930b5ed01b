# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudAssembly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudAssemblyInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    first_points : ndarray of float64, shape (n,3)
        Finite points, metres.
    second_points : ndarray of float64, shape (m,3)
        Finite points in the same frame, metres.
    view_centre_m : ndarray of float64, shape (3), optional
        Centre of the sphere, metres; default: the origin.
    view_radius_m : float, optional
        Radius of the sphere, metres; points outside are removed; default: no limit.
    """

    ARRAYS = ArrayPorts(
        {"first_points": "float64[n,3]", "second_points": "float64[m,3]", "view_centre_m": "float64[3]"},
        finite=["view_centre_m"],
        positive=["view_radius_m"],
        optional=["view_centre_m", "view_radius_m"],
    )

    first_points: NDArray[np.float64]
    second_points: NDArray[np.float64]
    view_centre_m: NDArray[np.float64] | None = None
    view_radius_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudAssemblyOutputs:
    """Outputs of one call.

    Attributes
    ----------
    assembled_points : ndarray of float64, shape (k,3)
        The joined cloud, metres.
    """

    assembled_points: NDArray[np.float64]


class PointCloudAssemblyInterface(Dfn[ConfigT, PointCloudAssemblyInputs, PointCloudAssemblyOutputs]):
    """Join two clouds in the same frame without duplicating common surfaces; optionally crop both to a
    sphere (the view).
    """


#: Short names for the implementations.
Inputs = PointCloudAssemblyInputs
Outputs = PointCloudAssemblyOutputs
Interface = PointCloudAssemblyInterface
