# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudAssembly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudAssemblyInputs:
    """Inputs of one call.

    Attributes
    ----------
    first_points : ndarray of float64, shape (n,3)
        Finite points, metres.
    second_points : ndarray of float64, shape (m,3)
        Finite points in the same frame, metres.
    view_centre_m : ndarray of float64, shape (3), optional
        Middle of the view, metres.
    view_radius_m : ndarray of float64, shape (), optional
        Points farther from the middle are dropped, metres; all are kept where it is absent.
    """

    first_points: NDArray[np.float64]
    second_points: NDArray[np.float64]
    view_centre_m: NDArray[np.float64] | None = None
    view_radius_m: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudAssemblyOutputs:
    """Outputs of one call.

    Attributes
    ----------
    assembled_points : ndarray of float64, shape (k,3)
        The joined cloud, metres.
    """

    assembled_points: NDArray[np.float64]


class PointCloudAssemblyInterface(Dfn[Any, PointCloudAssemblyInputs, PointCloudAssemblyOutputs]):
    """Join two clouds of one frame into one without doubling what both saw; keep what lies within the view where one
    is given.
    """
