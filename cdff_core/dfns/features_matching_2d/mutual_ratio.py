# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exhaustive nearest neighbours with mutual test and ratio test."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from cdff_common.arrays import ByteArray, Float32Array, IntArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_2d._kernels import (
    EXCLUDED,
    Neighbours,
    search_along_lines,
    update_nearest,
)
from cdff_core.dfns.features_matching_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.two_view import homogeneous

#: Rows of the matrix of distances that are computed at a time, so that they fit in the cache.
_BLOCK_ROWS = 512


class MutualRatioConfig(DfnConfig):
    """Parameters of MutualRatio."""

    norm: Literal["auto", "euclidean", "hamming"] = Field(
        "auto",
        description="Distance of descriptors; auto is hamming for descriptors of 32 bytes, else euclidean",
    )
    max_ratio: float = Field(
        0.85, gt=0, le=1, description="Largest ratio of nearest to second nearest distance"
    )
    mutual: bool = Field(True, description="Require that both descriptors are the nearest of each other")
    max_matches: int = Field(
        20_000, ge=1, le=1_000_000, description="Maximum number of matches, by smallest ratio"
    )
    band_px: float = Field(
        3.0,
        gt=0,
        le=1000,
        description="Largest Sampson distance of a pair, if a fundamental matrix is given",
    )


class MutualRatio(Interface[MutualRatioConfig]):
    """Mutual nearest descriptors that are clearly nearer than the second nearest [1]_.

    With a fundamental matrix, only points near the epipolar line are compared, so that a similar structure
    elsewhere in the image does not make a match ambiguous.

    References
    ----------
    .. [1] D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 60(2), 2004,
       doi:10.1023/B:VISI.0000029664.99615.94
    """

    def setup(self) -> None:
        """Compile the kernels."""
        for width in (32, 128):
            one = np.zeros((1, width), np.uint8)
            self._find_nearest(Inputs(source=one, sink=one))
            self._find_nearest(
                Inputs(
                    source=one,
                    sink=one,
                    source_features=np.zeros((1, 2)),
                    sink_features=np.zeros((1, 2)),
                    fundamental_matrix=np.eye(3),
                )
            )

    def process(self, inputs: Inputs) -> Outputs:
        """Return the matches; raises InputError for a fundamental matrix without points."""
        cfg = self.config
        if not (len(inputs.source) and len(inputs.sink)):
            return Outputs(matches=np.zeros((0, 2), np.int64), distances=np.zeros(0), ratios=np.zeros(0))
        nearest_sink, distances2, nearest_source = self._find_nearest(inputs)
        rows = np.arange(len(nearest_sink))
        nearest2, second2 = distances2.astype(np.float64).T
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(second2 > 0.0, np.sqrt(nearest2 / second2), 1.0)
            if self._is_hamming(inputs.source):
                ratios = ratios**2  # Hamming distances are not squared
        is_match = (nearest2 < EXCLUDED) & (ratios <= cfg.max_ratio)
        if cfg.mutual:
            is_match &= nearest_source[nearest_sink] == rows
        selected = np.flatnonzero(is_match)
        selected = selected[np.argsort(ratios[selected], kind="stable")[: cfg.max_matches]]
        distances = nearest2 if self._is_hamming(inputs.source) else np.sqrt(nearest2)
        return Outputs(
            matches=np.column_stack([selected, nearest_sink[selected]]).astype(np.int64),
            distances=distances[selected],
            ratios=ratios[selected],
        )

    def _find_nearest(self, inputs: Inputs) -> tuple[IntArray, Float32Array, IntArray]:
        """Return the nearest neighbours of both images.

        The nearest sink of each source ``(n,)``, the squared (or Hamming) distances of the nearest and second
        nearest sink ``(n, 2)``, and the nearest source of each sink ``(m,)``.
        """
        source, sink = np.ascontiguousarray(inputs.source), np.ascontiguousarray(inputs.sink)
        is_hamming = self._is_hamming(source)
        neighbours = Neighbours(
            sink=np.zeros(len(source), np.int64),
            sink_distances2=np.full((len(source), 2), EXCLUDED),
            source=np.zeros(len(sink), np.int64),
            source_distances2=np.full(len(sink), EXCLUDED),
        )
        if inputs.fundamental_matrix is not None:
            lines, points = _epipolar_lines(inputs)
            search_along_lines(source, sink, lines, points, self.config.band_px, is_hamming, neighbours)
        else:
            self._search_all(_vectors(source, is_hamming), _vectors(sink, is_hamming), is_hamming, neighbours)
        return neighbours.sink, neighbours.sink_distances2, neighbours.source

    def _search_all(
        self, source: Float32Array, sink: Float32Array, is_hamming: bool, neighbours: Neighbours
    ) -> None:
        """Update the nearest neighbours by all pairs of the vectors ``(n, d)`` and ``(m, d)``.

        The squared distance of a and b is the product of ``(-2 a, |a|^2, 1)`` and ``(b, 1, |b|^2)``. For
        descriptors of at most 128 bytes all sums are integers below 2^24, which are exact in single
        precision; longer ones are rounded, but not below 0.
        """
        source_norms2, sink_norms2 = (np.einsum("ij,ij->i", v, v)[:, None] for v in (source, sink))
        scale = np.float32(0.25 if is_hamming else 1.0)  # vectors of signs: each differing bit adds 4
        left = scale * np.hstack([np.float32(-2.0) * source, source_norms2, np.ones_like(source_norms2)])
        right = np.ascontiguousarray(np.hstack([sink, np.ones_like(sink_norms2), sink_norms2]).T)
        for start in range(0, len(source), _BLOCK_ROWS):
            update_nearest(left[start : start + _BLOCK_ROWS] @ right, start, neighbours)
        np.maximum(neighbours.sink_distances2, np.float32(0.0), out=neighbours.sink_distances2)

    def _is_hamming(self, descriptors: ByteArray) -> bool:
        """Return whether descriptors are compared by the Hamming distance."""
        norm = self.config.norm
        return norm == "hamming" or (norm == "auto" and descriptors.shape[1] == 32)


def _vectors(descriptors: ByteArray, is_hamming: bool) -> Float32Array:
    """Return the descriptors as numbers, or their bits as signs ``(n, bits)``."""
    if is_hamming:
        return np.float32(2.0) * np.unpackbits(descriptors, axis=1) - np.float32(1.0)
    return descriptors.astype(np.float32)


def _epipolar_lines(inputs: Inputs) -> tuple[Float32Array, Float32Array]:
    """Return the arguments ``lines`` and ``points`` of ``search_along_lines``; raises InputError without
    points.
    """
    if inputs.source_features is None or inputs.sink_features is None:
        raise InputError("fundamentalMatrix without sourceFeatures and sinkFeatures: expected all three")
    F = np.asarray(inputs.fundamental_matrix, np.float64)
    points = np.asarray(inputs.sink_features, np.float64)
    sink_lines = homogeneous(np.asarray(inputs.source_features, np.float64)) @ F.T
    source_lines = homogeneous(points) @ F
    scale = 1.0 / max(float(np.abs(np.vstack([sink_lines, source_lines])[:, :2]).max()), 1e-30)
    sink_gradients2, source_gradients2 = (
        ((scale * lines[:, :2]) ** 2).sum(axis=1) for lines in (sink_lines, source_lines)
    )
    return (
        np.column_stack([scale * sink_lines, sink_gradients2]).astype(np.float32),
        np.ascontiguousarray(np.column_stack([points, source_gradients2]).T, np.float32),
    )
