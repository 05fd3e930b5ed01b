# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assignment of regions to objects with the least sum of squared normalised differences.

References
----------
.. [1] Crouse, D. F. (2016). On implementing 2D rectangular assignment algorithms. IEEE Transactions on
   Aerospace and Electronic Systems 52(4). doi:10.1109/TAES.2016.140952
"""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.optimize import linear_sum_assignment

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.track_association.interface import Inputs, Interface, Outputs

#: Cost of a pair outside the gate.
_NEVER = 1e6


class JointAssignmentConfig(DfnConfig):
    """Parameters of JointAssignment."""

    gate: float = Field(25.0, gt=0.0, le=1e4, description="Largest squared normalised difference of a pair")
    appearance_sigma: float = Field(
        0.25, gt=0.01, le=2.0, description="Standard deviation of 1 minus the correlation of the same object"
    )
    ambiguity: float = Field(
        6.0, ge=0.0, le=1e3, description="Difference of costs below which a pair is ambiguous"
    )


class JointAssignment(Interface[JointAssignmentConfig]):
    """Assignment with the least sum of squared normalised differences over all pairs [1]_.

    The differences are those of position, logarithm of the size, and appearance.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the region of each object."""
        m, n = len(inputs.places), len(inputs.regions)
        region_rows, costs = np.full(m, -1, np.int64), np.full(m, np.nan)
        ambiguous = np.zeros(m, bool)
        if m == 0 or n == 0:
            return Outputs(chosen=region_rows, costs=costs, is_ambiguous=ambiguous)
        cost = self._costs(inputs)
        allowed = np.where(cost <= self.config.gate, cost, _NEVER)
        # An object without a region costs as much as the gate: a pair outside it is never chosen.
        square = np.concatenate([allowed, np.full((m, m), self.config.gate)], axis=1)
        rows, columns = linear_sum_assignment(square)
        for i, j in zip(rows, columns, strict=True):
            if j >= n or allowed[i, j] >= _NEVER:
                continue
            region_rows[i], costs[i] = j, cost[i, j]
            others = np.concatenate([np.delete(cost[i], j), np.delete(cost[:, j], i)])
            rival = float(others.min(initial=np.inf))
            ambiguous[i] = rival <= self.config.gate and rival - cost[i, j] < self.config.ambiguity
        return Outputs(chosen=region_rows, costs=costs, is_ambiguous=ambiguous)

    def _costs(self, inputs: Inputs) -> FloatArray:
        """Return the squared normalised differences (m, n)."""
        difference = inputs.regions[None] - inputs.places[:, None]
        S = inputs.covariances[:, None] + inputs.region_covariances[None]
        cost = np.einsum("mni,mnij,mnj->mn", difference, np.linalg.inv(S), difference)
        ratio = np.log(inputs.region_sizes[None] / inputs.sizes[:, None])
        cost += (ratio**2).sum(axis=2) / inputs.size_sigmas[:, None] ** 2
        if inputs.similarities is not None:
            unlike = (1.0 - inputs.similarities) / self.config.appearance_sigma
            cost += np.where(np.isfinite(unlike), unlike**2, 0.0)
        return np.asarray(cost)
