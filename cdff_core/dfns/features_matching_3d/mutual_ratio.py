# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Nearest neighbours in descriptor space, both ways, with a bound on their ambiguity."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_3d._interface import (
    FeaturesMatching3DInputs,
    FeaturesMatching3DInterface,
    FeaturesMatching3DOutputs,
)

_BLOCK_ROWS = 1024


class MutualRatioConfig(DfnConfig):
    """Which pairs are kept."""

    max_ratio: float = Field(1.0, gt=0.0, le=1.0, description="Largest nearest over second nearest distance")
    mutual: bool = Field(True, description="Whether a pair must be nearest both ways")
    max_matches: int = Field(5000, ge=1, le=1_000_000, description="Matches at most")


class MutualRatio(FeaturesMatching3DInterface):
    """Exhaustive search; a pair is kept if it is mutual and its ratio is small enough.

    Lowe (2004), doi:10.1023/B:VISI.0000029664.99615.94, for the ratio.
    """

    Config: ClassVar[type[DfnConfig]] = MutualRatioConfig

    def process(self, inputs: FeaturesMatching3DInputs) -> FeaturesMatching3DOutputs:
        """Return the matches; raises InputError where the descriptors do not fit."""
        cfg: Any = self.config
        source, target = _checked(inputs.source, "source"), _checked(inputs.target, "target")
        if source.shape[1] != target.shape[1]:
            raise InputError(f"descriptors of {source.shape[1]} and {target.shape[1]} values, expected the same length")
        if not (len(source) and len(target)):
            nothing = np.zeros(0, np.float32)
            return FeaturesMatching3DOutputs(np.zeros((0, 2), np.int64), nothing, nothing)
        nearest, first, second, back = _nearest(source, target)
        rows = np.arange(len(source))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(second > 0.0, first / second, 1.0)
        keep = ratio <= cfg.max_ratio
        if cfg.mutual:
            keep &= back[nearest] == rows
        chosen = np.flatnonzero(keep)
        chosen = chosen[np.argsort(ratio[chosen], kind="stable")[: cfg.max_matches]]
        return FeaturesMatching3DOutputs(
            matches=np.stack([chosen, nearest[chosen]], axis=1), distances=first[chosen], ratios=ratio[chosen]
        )


def _checked(descriptors: Any, name: str) -> NDArray[np.float32]:
    d = np.ascontiguousarray(descriptors, dtype=np.float32)
    if d.ndim != 2 or not np.all(np.isfinite(d)):
        raise InputError(f"{name}: shape {d.shape}, expected finite values of shape (n, d)")
    return d


def _nearest(
    source: NDArray[np.float32], target: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Per source row the nearest target, its distance and that of the second; per target row the nearest source."""
    nearest, back = np.empty(len(source), np.int64), np.zeros(len(target), np.int64)
    first, second = np.empty(len(source), np.float32), np.full(len(source), np.inf, np.float32)
    back_d2 = np.full(len(target), np.inf, np.float32)
    target_norm2 = np.einsum("ij,ij->i", target, target)
    for low in range(0, len(source), _BLOCK_ROWS):
        block = source[low : low + _BLOCK_ROWS]
        d2 = np.maximum(np.einsum("ij,ij->i", block, block)[:, None] + target_norm2 - 2.0 * (block @ target.T), 0.0)
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
