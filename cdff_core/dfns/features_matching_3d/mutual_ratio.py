# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Nearest neighbours in descriptor space with mutual and ratio test."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, IntArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_3d.interface import Inputs, Interface, Outputs

_BLOCK_ROWS = 1024


class MutualRatioConfig(DfnConfig):
    """Parameters of MutualRatio."""

    max_ratio: float = Field(
        1.0, gt=0, le=1, description="Largest ratio of nearest to second nearest distance"
    )
    mutual: bool = Field(True, description="Require that both descriptors are the nearest of each other")
    max_matches: int = Field(
        5000, ge=1, le=1_000_000, description="Maximum number of matches, by smallest ratio"
    )


class MutualRatio(Interface[MutualRatioConfig]):
    """Exhaustive search for mutual nearest neighbours with a bound on the distance ratio.

    Lowe (2004), doi:10.1023/B:VISI.0000029664.99615.94, for the ratio.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the matches."""
        cfg = self.config
        source, target = (np.ascontiguousarray(d, np.float32) for d in (inputs.source, inputs.target))
        if not (len(source) and len(target)):
            nothing = np.zeros(0, np.float32)
            return Outputs(matches=np.zeros((0, 2), np.int64), distances=nothing, ratios=nothing)
        nearest, first, second, back = _nearest(source, target)
        rows = np.arange(len(source))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(second > 0.0, first / second, 1.0)
        keep = ratio <= cfg.max_ratio
        if cfg.mutual:
            keep &= back[nearest] == rows
        chosen = np.flatnonzero(keep)
        chosen = chosen[np.argsort(ratio[chosen], kind="stable")[: cfg.max_matches]]
        return Outputs(
            matches=np.stack([chosen, nearest[chosen]], axis=1), distances=first[chosen], ratios=ratio[chosen]
        )


def _nearest(
    source: Float32Array, target: Float32Array
) -> tuple[IntArray, Float32Array, Float32Array, IntArray]:
    """Return nearest target and two smallest distances per source, nearest source per target."""
    nearest, back = np.empty(len(source), np.int64), np.zeros(len(target), np.int64)
    first, second = np.empty(len(source), np.float32), np.full(len(source), np.inf, np.float32)
    back_d2 = np.full(len(target), np.inf, np.float32)
    target_norm2 = np.einsum("ij,ij->i", target, target)
    for low in range(0, len(source), _BLOCK_ROWS):
        block = source[low : low + _BLOCK_ROWS]
        d2 = np.maximum(
            np.einsum("ij,ij->i", block, block)[:, None] + target_norm2 - 2.0 * (block @ target.T), 0.0
        )
        column = np.argmin(d2, axis=0)
        at_column = d2[column, np.arange(len(target))]
        better = at_column < back_d2
        back[better], back_d2[better] = column[better] + low, at_column[better]
        row = np.argmin(d2, axis=1)
        here = slice(low, low + len(block))
        nearest[here], first[here] = row, np.sqrt(d2[np.arange(len(block)), row])
        d2[np.arange(len(block)), row] = np.inf
        second[here] = np.sqrt(d2.min(axis=1))
    return nearest, first, second, back
