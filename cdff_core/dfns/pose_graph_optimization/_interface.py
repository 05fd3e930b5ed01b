# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PoseGraphOptimization."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import PoseGraph


@dataclass(frozen=True, slots=True, eq=False)
class PoseGraphOptimizationInputs:
    """Inputs of one call.

    Attributes
    ----------
    graph : PoseGraph
        Poses and what was measured between them; without fixed vertices or priors the vertex of the least id of
        each component is held.
    wanted : ndarray of int64, shape (k), optional
        Ids of vertices whose covariance is asked for.
    """

    graph: PoseGraph
    wanted: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PoseGraphOptimizationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    graph : PoseGraph
        The same graph with the poses that were found; fixed marks what was held.
    iterations : ndarray of int64, shape ()
        Normal equations solved.
    converged : ndarray of bool, shape ()
        Whether the last step changed nothing that counts.
    gauge : ndarray of int64, shape (g)
        Ids of the vertices that were held.
    weights : ndarray of float64, shape (m)
        Weight of each edge at the end: 1, or 0 for a loop closure that was rejected.
    covariances : ndarray of float64, shape (k,6,6)
        Of the poses wanted, relative to what was held: x y z rx ry rz, perturbation in the graph's frame.
    """

    graph: PoseGraph
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    gauge: NDArray[np.int64]
    weights: NDArray[np.float64]
    covariances: NDArray[np.float64]


class PoseGraphOptimizationInterface(Dfn[Any, PoseGraphOptimizationInputs, PoseGraphOptimizationOutputs]):
    """Find the poses that agree best with all measurements between them: least squares, plane or spatial, from no or
    any initial poses, on request without the loop closures that contradict the rest.
    """
