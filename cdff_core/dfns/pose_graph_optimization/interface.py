# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PoseGraphOptimization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import PoseGraph


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseGraphOptimizationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    graph : PoseGraph
        Poses and relative measurements; in a component without fixed vertices and priors, the vertex with
        the smallest id is fixed.
    wanted : ndarray of int64, shape (k), optional
        Ids of the vertices for which covariances are computed.
    """

    ARRAYS = ArrayPorts({"wanted": "int64[k]"}, optional=["wanted"])

    graph: PoseGraph
    wanted: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseGraphOptimizationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    graph : PoseGraph
        The same graph with the estimated poses; fixed marks the fixed vertices.
    iterations : int
        Number of normal equations solved.
    converged : bool
        True if the last step was below the tolerance.
    gauge : ndarray of int64, shape (g)
        Ids of the fixed vertices.
    weights : ndarray of float64, shape (m)
        Final weight of each edge: 1, or 0 for a rejected loop closure.
    covariances : ndarray of float64, shape (k,6,6)
        Covariances of the wanted poses relative to the fixed vertices: [x y z rx ry rz], perturbation in
        the graph's frame.
    """

    graph: PoseGraph
    iterations: int
    converged: bool
    gauge: NDArray[np.int64]
    weights: NDArray[np.float64]
    covariances: NDArray[np.float64]


class PoseGraphOptimizationInterface(Dfn[ConfigT, PoseGraphOptimizationInputs, PoseGraphOptimizationOutputs]):
    """Estimate the poses that minimise the squared errors of all relative measurements, in the plane
    or in space, with or without initial poses. Optionally wrong loop closures are rejected.
    """


#: Short names for the implementations.
Inputs = PoseGraphOptimizationInputs
Outputs = PoseGraphOptimizationOutputs
Interface = PoseGraphOptimizationInterface
