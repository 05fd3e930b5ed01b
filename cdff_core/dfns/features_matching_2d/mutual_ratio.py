# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exhaustive nearest neighbours with mutual and ratio test."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, ByteArray, Float32Array
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.two_view import homogeneous

_BLOCK_ROWS = 1024
_FAR = np.float32(1e12)


class MutualRatioConfig(DfnConfig):
    """Parameters of MutualRatio."""

    norm: Literal["auto", "euclidean", "hamming"] = Field(
        "auto", description="Distance of descriptors; auto takes hamming for descriptors of 32 bytes"
    )
    max_ratio: float = Field(
        0.85, gt=0, le=1, description="Largest ratio of nearest to second nearest distance"
    )
    mutual: bool = Field(True, description="Require that both descriptors are the nearest of each other")
    max_matches: int = Field(
        20_000, ge=1, le=1_000_000, description="Maximum number of matches, by smallest ratio"
    )
    band_px: float = Field(
        3.0, gt=0, le=1000, description="Largest distance from the epipolar line, with a fundamental matrix"
    )


class MutualRatio(Interface[MutualRatioConfig]):
    """Nearest descriptors that are mutual and clearly nearer than the second nearest [1]_.

    With a fundamental matrix only points near the epipolar line are compared, so that a repeated structure
    elsewhere in the image does not make a point ambiguous.

    References
    ----------
    .. [1] D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 60(2), 2004,
       doi:10.1023/B:VISI.0000029664.99615.94
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the matches; raises InputError for a fundamental matrix without points."""
        c = self.config
        source, sink = np.asarray(inputs.source), np.asarray(inputs.sink)
        if not (len(source) and len(sink)):
            return Outputs(matches=np.zeros((0, 2), np.int64), distances=np.zeros(0), ratios=np.zeros(0))
        squared = self._squared(source, sink)
        if inputs.fundamental_matrix is not None:
            squared[~self._near_lines(inputs, len(source), len(sink))] = _FAR
        nearest, back = squared.argmin(axis=1), squared.argmin(axis=0)
        rows = np.arange(len(source))
        first = squared[rows, nearest].astype(np.float64)
        squared[rows, nearest] = _FAR
        second = squared.min(axis=1).astype(np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(second > 0.0, np.sqrt(first / second), 1.0)
            if self._hamming(source):
                ratios = ratios**2  # Hamming distances are not squared
        keep = (first < _FAR) & (ratios <= c.max_ratio)
        if c.mutual:
            keep &= back[nearest] == rows
        chosen = np.flatnonzero(keep)
        chosen = chosen[np.argsort(ratios[chosen], kind="stable")[: c.max_matches]]
        distances = first if self._hamming(source) else np.sqrt(first)
        return Outputs(
            matches=np.column_stack([chosen, nearest[chosen]]).astype(np.int64),
            distances=distances[chosen],
            ratios=ratios[chosen],
        )

    def _hamming(self, descriptors: ByteArray) -> bool:
        norm = self.config.norm
        return norm == "hamming" or (norm == "auto" and descriptors.shape[1] == 32)

    def _squared(self, source: ByteArray, sink: ByteArray) -> Float32Array:
        """Return squared Euclidean, or Hamming, distances ``(n, m)``."""
        if self._hamming(source):
            bits = 8 * source.shape[1]
            a, b = (np.float32(2.0) * np.unpackbits(d, axis=1) - np.float32(1.0) for d in (source, sink))
            return np.asarray((np.float32(bits) - a @ b.T) / np.float32(2.0))
        a, b = source.astype(np.float32), sink.astype(np.float32)
        squared = a @ b.T
        squared *= np.float32(-2.0)
        squared += np.einsum("ij,ij->i", a, a)[:, None]
        squared += np.einsum("ij,ij->i", b, b)
        return np.maximum(squared, np.float32(0.0), out=squared)

    def _near_lines(self, inputs: Inputs, n: int, m: int) -> BoolArray:
        """Return which pairs ``(n, m)`` lie within the band about epipolar lines, by Sampson distance."""
        F = np.asarray(inputs.fundamental_matrix, np.float64)
        if inputs.source_features is None or inputs.sink_features is None:
            raise InputError("fundamentalMatrix without sourceFeatures and sinkFeatures: expected all three")
        x = homogeneous(np.asarray(inputs.source_features, np.float64))
        y = homogeneous(np.asarray(inputs.sink_features, np.float64))
        lines, back = x @ F.T, y @ F
        near = np.empty((n, m), bool)
        for low in range(0, n, _BLOCK_ROWS):
            block = lines[low : low + _BLOCK_ROWS]
            steep = (block[:, :2] ** 2).sum(axis=1)[:, None] + (back[:, :2] ** 2).sum(axis=1)
            near[low : low + len(block)] = (block @ y.T) ** 2 <= self.config.band_px**2 * steep
        return near
