# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exhaustive nearest neighbours with mutual test and ratio test."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, ByteArray, Float32Array
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.two_view import homogeneous

#: Rows of the source that are compared with the epipolar lines at a time, to limit memory.
_BLOCK_ROWS = 1024
#: Distance of excluded pairs.
_EXCLUDED = np.float32(1e12)


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

    def process(self, inputs: Inputs) -> Outputs:
        """Return the matches; raises InputError for a fundamental matrix without points."""
        cfg = self.config
        source, sink = np.asarray(inputs.source), np.asarray(inputs.sink)
        if not (len(source) and len(sink)):
            return Outputs(matches=np.zeros((0, 2), np.int64), distances=np.zeros(0), ratios=np.zeros(0))
        distances2 = self._distances(source, sink)
        if inputs.fundamental_matrix is not None:
            distances2[~self._is_near_epipolar_line(inputs, len(source), len(sink))] = _EXCLUDED
        nearest_sink, nearest_source = distances2.argmin(axis=1), distances2.argmin(axis=0)
        rows = np.arange(len(source))
        nearest2 = distances2[rows, nearest_sink].astype(np.float64)
        distances2[rows, nearest_sink] = _EXCLUDED
        second2 = distances2.min(axis=1).astype(np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(second2 > 0.0, np.sqrt(nearest2 / second2), 1.0)
            if self._is_hamming(source):
                ratios = ratios**2  # Hamming distances are not squared
        is_match = (nearest2 < _EXCLUDED) & (ratios <= cfg.max_ratio)
        if cfg.mutual:
            is_match &= nearest_source[nearest_sink] == rows
        selected = np.flatnonzero(is_match)
        selected = selected[np.argsort(ratios[selected], kind="stable")[: cfg.max_matches]]
        distances = nearest2 if self._is_hamming(source) else np.sqrt(nearest2)
        return Outputs(
            matches=np.column_stack([selected, nearest_sink[selected]]).astype(np.int64),
            distances=distances[selected],
            ratios=ratios[selected],
        )

    def _is_hamming(self, descriptors: ByteArray) -> bool:
        """Return whether descriptors are compared by the Hamming distance."""
        norm = self.config.norm
        return norm == "hamming" or (norm == "auto" and descriptors.shape[1] == 32)

    def _distances(self, source: ByteArray, sink: ByteArray) -> Float32Array:
        """Return the Hamming distances, or the squared Euclidean distances, ``(n, m)``."""
        if self._is_hamming(source):
            bits = 8 * source.shape[1]
            a, b = (np.float32(2.0) * np.unpackbits(d, axis=1) - np.float32(1.0) for d in (source, sink))
            return np.asarray((np.float32(bits) - a @ b.T) / np.float32(2.0))
        a, b = source.astype(np.float32), sink.astype(np.float32)
        distances2 = a @ b.T
        distances2 *= np.float32(-2.0)
        distances2 += np.einsum("ij,ij->i", a, a)[:, None]
        distances2 += np.einsum("ij,ij->i", b, b)
        return np.maximum(distances2, np.float32(0.0), out=distances2)

    def _is_near_epipolar_line(self, inputs: Inputs, source_count: int, sink_count: int) -> BoolArray:
        """Return which pairs ``(n, m)`` have a Sampson distance of at most ``band_px``."""
        F = np.asarray(inputs.fundamental_matrix, np.float64)
        if inputs.source_features is None or inputs.sink_features is None:
            raise InputError("fundamentalMatrix without sourceFeatures and sinkFeatures: expected all three")
        source_points = homogeneous(np.asarray(inputs.source_features, np.float64))
        sink_points = homogeneous(np.asarray(inputs.sink_features, np.float64))
        sink_lines, source_lines = source_points @ F.T, sink_points @ F
        is_near = np.empty((source_count, sink_count), bool)
        for start in range(0, source_count, _BLOCK_ROWS):
            block = sink_lines[start : start + _BLOCK_ROWS]
            gradient2 = (block[:, :2] ** 2).sum(axis=1)[:, None] + (source_lines[:, :2] ** 2).sum(axis=1)
            algebraic_error = block @ sink_points.T
            is_near[start : start + len(block)] = algebraic_error**2 <= self.config.band_px**2 * gradient2
        return is_near
