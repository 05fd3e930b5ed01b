# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled iterations of point-to-plane ICP."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray
from cdff_common.geometry.kdtree import KdTree
from cdff_core.dfns.registration_3d import _kernels, _steps

#: Minimum gate in robust standard deviations of the residuals.
_GATE_PER_SCALE = 6.0
#: Factor on the gate per iteration.
_ANNEALING = 0.8
#: Least number of residuals from which the robust scale is computed.
_SCALE_SAMPLE = 4000
#: Ratio of a gate to that of the newest scale up to which steps are extrapolated. A gate that follows the
#: scale of the residuals varies with it by a few percent, twice the sampling error of a scale of 4000
#: distances (Rousseeuw and Croux 1993, doi:10.2307/2291267).
_EQUAL_GATES = 1.04


class Limits(NamedTuple):
    """Gates, kernel and end of the iterations.

    Attributes
    ----------
    first_gate_m, final_gate_m : float
        Largest distance of a pair at the first and at the last iterations.
    tolerance_m : float
        Step below which the iteration has converged.
    kernel : int
        Number of the robust kernel.
    kernel_scales, kernel_gates : float
        Width of the kernel in robust standard deviations, and its minimum as a fraction of the gate.
    max_iterations, min_pairs : int
    """

    first_gate_m: float
    final_gate_m: float
    tolerance_m: float
    kernel: int
    kernel_scales: float
    kernel_gates: float
    max_iterations: int
    min_pairs: int


class Iterations(NamedTuple):
    """Result of the iterations; too few pairs within ``gate_m`` end them."""

    T_target_source: FloatArray
    scale_m: float
    iterations: int
    converged: bool
    pairs: int
    gate_m: float


@njit(cache=True)
def iterate(
    tree: KdTree, normals: FloatArray, source: FloatArray, T_target_source: FloatArray, limits: Limits
) -> Iterations:  # pragma: no cover - compiled
    """Alternate pairing and Gauss-Newton steps from ``T_target_source`` until a step is below the
    tolerance; ``normals`` have the order of the tree.
    """
    pairs = _kernels.no_pairs(len(source))
    steps = np.empty((limits.max_iterations, 6))
    gate_m, scale_m, length, converged, k = limits.first_gate_m, 0.0, 1.0, False, 0
    while k < limits.max_iterations and not converged:
        count = _kernels.pair(tree, source, T_target_source, gate_m, pairs)
        if count < limits.min_pairs:
            return Iterations(T_target_source, scale_m, k, False, count, gate_m)
        distances_m = _kernels.plane_distances(tree.points, normals, pairs.row, pairs.moved)
        scale_m = max(1.4826 * np.median(np.abs(distances_m[:: max(1, count // _SCALE_SAMPLE)])), 1e-9)
        # The kernel is wide while the gate is wide: otherwise rings on the ground that match each other
        # would outweigh the structures of the scene.
        width_m = max(limits.kernel_scales * scale_m, limits.kernel_gates * gate_m)
        centre, radius_m = _kernels.centre_and_radius(pairs.row, pairs.moved)
        H, g = _kernels.plane_equations(
            tree.points, normals, pairs.row, pairs.moved, centre, radius_m, width_m, limits.kernel
        )
        steps[k] = _steps.newton_step(H, g)
        k += 1
        last_gate_m = max(limits.final_gate_m, _GATE_PER_SCALE * scale_m)
        length = _steps.step_length(steps[:k], length != 1.0) if gate_m <= _EQUAL_GATES * last_gate_m else 1.0
        T_target_source = _steps.moved_by(T_target_source, length * steps[k - 1], centre, radius_m)
        converged = gate_m <= last_gate_m and _steps.has_converged(steps[:k], limits.tolerance_m)
        gate_m = max(last_gate_m, _ANNEALING * gate_m)
    return Iterations(T_target_source, scale_m, k, converged, count, gate_m)
