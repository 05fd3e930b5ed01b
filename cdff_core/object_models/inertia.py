# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Inertia tensors up to a factor: their trace is 3, and five numbers describe the deviation from a sphere."""

from __future__ import annotations

import math

import numpy as np

from cdff_common.arrays import FloatArray

#: Bounds of a principal moment for a trace of 3: above half the trace it would exceed the sum of the other
#: two.
_LEAST, _GREATEST = 0.05, 1.49


def _basis() -> FloatArray:
    a, b = 1.0 / math.sqrt(2.0), 1.0 / math.sqrt(6.0)
    E = np.zeros((5, 3, 3))
    E[0] = np.diag([a, -a, 0.0])
    E[1] = np.diag([b, b, -2.0 * b])
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        E[2 + k, i, j] = E[2 + k, j, i] = a
    return E


#: Symmetric matrices (5, 3, 3) without trace, of Frobenius norm 1: directions of the errors of an inertia.
BASIS = _basis()


def inertia_of(ratios: tuple[float, float, float]) -> FloatArray:
    """Return the inertia (3, 3) with trace 3 of principal moments along the axes of the body."""
    return np.diag(3.0 * np.asarray(ratios) / sum(ratios))


def changed_inertia(inertia: FloatArray, errors: FloatArray) -> FloatArray:
    """Return the inertia (3, 3) plus errors (5,) along ``BASIS``,
    restricted to the inertia of a real body.
    """
    moments, axes = np.linalg.eigh(inertia + np.tensordot(errors, BASIS, axes=1))
    moments = np.clip(moments, _LEAST, _GREATEST)
    return np.asarray((axes * (3.0 * moments / moments.sum())) @ axes.T)


def inertia_difference(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the errors (5,) that lead from the second inertia to the first."""
    return np.asarray(np.tensordot(BASIS, first - second, axes=2))
