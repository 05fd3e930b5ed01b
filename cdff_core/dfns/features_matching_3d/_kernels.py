# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop of MutualRatio: two nearest targets of each source, nearest source of each target."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import Float32Array, IntArray


class Neighbours(NamedTuple):
    """Nearest neighbours of n sources and m targets; ``update_nearest`` updates the arrays."""

    target: IntArray  # (n,), nearest target of each source
    target_distances2: Float32Array  # (n, 2), squared distances of nearest and second nearest target
    source: IntArray  # (m,), nearest source of each target
    source_distances2: Float32Array  # (m,), its squared distance


def no_neighbours(sources: int, targets: int) -> Neighbours:
    """Return the neighbours before the first update: distances are infinite."""
    return Neighbours(
        target=np.zeros(sources, np.int64),
        target_distances2=np.full((sources, 2), np.inf, np.float32),
        source=np.zeros(targets, np.int64),
        source_distances2=np.full(targets, np.inf, np.float32),
    )


@njit(cache=True)
def update_nearest(
    distances2: Float32Array, start: int, neighbours: Neighbours
) -> None:  # pragma: no cover - compiled
    """Update the neighbours by squared distances ``(k, m)`` of the sources ``start`` to ``start + k``."""
    for k in range(distances2.shape[0]):
        row = distances2[k]
        nearest2, second2, nearest = np.float32(np.inf), np.float32(np.inf), 0
        for j in range(len(row)):
            if row[j] < second2:
                if row[j] < nearest2:
                    second2, nearest2, nearest = nearest2, row[j], j
                else:
                    second2 = row[j]
            if row[j] < neighbours.source_distances2[j]:
                neighbours.source_distances2[j], neighbours.source[j] = row[j], start + k
        neighbours.target[start + k] = nearest
        neighbours.target_distances2[start + k, 0] = nearest2
        neighbours.target_distances2[start + k, 1] = second2
