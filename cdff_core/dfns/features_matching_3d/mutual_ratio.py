# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exhaustive nearest neighbours with mutual test and ratio test."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, IntArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_3d.interface import Inputs, Interface, Outputs

#: Rows of the source that are compared with all targets at a time, to limit memory.
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
            empty = np.zeros(0, np.float32)
            return Outputs(matches=np.zeros((0, 2), np.int64), distances=empty, ratios=empty)
        nearest_target, nearest_distance, second_distance, nearest_source = _find_nearest(source, target)
        rows = np.arange(len(source))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(second_distance > 0.0, nearest_distance / second_distance, 1.0)
        is_match = ratio <= cfg.max_ratio
        if cfg.mutual:
            is_match &= nearest_source[nearest_target] == rows
        selected = np.flatnonzero(is_match)
        selected = selected[np.argsort(ratio[selected], kind="stable")[: cfg.max_matches]]
        return Outputs(
            matches=np.stack([selected, nearest_target[selected]], axis=1),
            distances=nearest_distance[selected],
            ratios=ratio[selected],
        )


def _find_nearest(
    source: Float32Array, target: Float32Array
) -> tuple[IntArray, Float32Array, Float32Array, IntArray]:
    """Return the nearest target of each source, the distances of the two nearest, and the nearest source of
    each target.
    """
    nearest_target, nearest_source = np.empty(len(source), np.int64), np.zeros(len(target), np.int64)
    nearest_distance, second_distance = np.empty(len(source), np.float32), np.empty(len(source), np.float32)
    source_d2 = np.full(len(target), np.inf, np.float32)
    target_norm2 = np.einsum("ij,ij->i", target, target)
    for start in range(0, len(source), _BLOCK_ROWS):
        block = source[start : start + _BLOCK_ROWS]
        d2 = np.maximum(
            np.einsum("ij,ij->i", block, block)[:, None] + target_norm2 - 2.0 * (block @ target.T), 0.0
        )
        source_row = np.argmin(d2, axis=0)
        column_d2 = d2[source_row, np.arange(len(target))]
        is_nearer = column_d2 < source_d2
        nearest_source[is_nearer], source_d2[is_nearer] = source_row[is_nearer] + start, column_d2[is_nearer]
        target_row = np.argmin(d2, axis=1)
        block_rows = slice(start, start + len(block))
        nearest_target[block_rows] = target_row
        nearest_distance[block_rows] = np.sqrt(d2[np.arange(len(block)), target_row])
        d2[np.arange(len(block)), target_row] = np.inf
        second_distance[block_rows] = np.sqrt(d2.min(axis=1))
    return nearest_target, nearest_distance, second_distance, nearest_source
