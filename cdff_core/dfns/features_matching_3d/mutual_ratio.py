# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exhaustive nearest neighbours with mutual test and ratio test."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, IntArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_3d._kernels import no_neighbours, update_nearest
from cdff_core.dfns.features_matching_3d.interface import Inputs, Interface, Outputs

#: Rows of the source that are compared with all targets at a time, so that the distances fit in the cache.
_BLOCK_ROWS = 256
#: Least number of descriptors per principal component from which the components are computed.
_SAMPLE_PER_COMPONENT = 4
#: Ratio of the variance of all discarded components to the total variance of the descriptors.
_MAX_DISCARDED = 1e-5


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

    def setup(self) -> None:
        """Compile the kernel."""
        one = np.zeros((1, 1), np.float32)
        _find_nearest(one, one)

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
    source, target = _principal_components(source, target)
    neighbours = no_neighbours(len(source), len(target))
    # The product of the extended rows (-2 s, s's, 1) and (t, 1, t't) is the squared distance of s and t.
    s2, t2 = (np.einsum("ij,ij->i", d, d)[:, None] for d in (source, target))
    extended_source = np.hstack([np.float32(-2.0) * source, s2, np.ones_like(s2)])
    extended_target = np.hstack([target, np.ones_like(t2), t2])
    for start in range(0, len(source), _BLOCK_ROWS):
        update_nearest(extended_source[start : start + _BLOCK_ROWS] @ extended_target.T, start, neighbours)
    distances = np.sqrt(np.maximum(neighbours.target_distances2, np.float32(0.0)))
    return neighbours.target, distances[:, 0], distances[:, 1], neighbours.source


def _principal_components(source: Float32Array, target: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return the descriptors in the principal components of a sample, without those of negligible variance.

    Neighbouring bins of a histogram are correlated, so that a third of the components of SHOT holds the
    distances.
    """
    size = source.shape[1]
    step = max(1, (len(source) + len(target)) // (_SAMPLE_PER_COMPONENT * size))
    sample = np.vstack([source[::step], target[::step]])
    sample -= sample.mean(axis=0)
    variances, axes = np.linalg.eigh(sample.T @ sample)
    discarded = np.cumsum(np.maximum(variances, 0.0))
    axes = axes[:, np.searchsorted(discarded, _MAX_DISCARDED * discarded[-1]) :]
    return (source @ axes, target @ axes) if axes.shape[1] < size else (source, target)
