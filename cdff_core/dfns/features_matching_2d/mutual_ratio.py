# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MutualRatio: exhaustive nearest neighbours, kept where they are mutual and unambiguous."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_matching_2d._interface import (
    FeaturesMatching2DInputs,
    FeaturesMatching2DInterface,
    FeaturesMatching2DOutputs,
)
from cdff_core.imaging.two_view import homogeneous

_BLOCK_ROWS = 1024
_FAR = np.float32(1e12)


class MutualRatioConfig(DfnConfig):
    """Which pairs are kept."""

    norm: Literal["auto", "euclidean", "hamming"] = "auto"
    max_ratio: Annotated[float, Field(gt=0, le=1)] = 0.85
    mutual: bool = True
    max_matches: Annotated[int, Field(ge=1, le=1_000_000)] = 20_000
    band_px: Annotated[float, Field(gt=0, le=1000)] = 3.0


class MutualRatio(FeaturesMatching2DInterface):
    """All distances; the nearest stays where it is mutual and clearly nearer than the second ([1]_).

    With a fundamental matrix only points near the epipolar line compete: a repeated structure that is elsewhere no
    longer makes a point ambiguous.

    References
    ----------
    .. [1] D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 60(2), 2004,
       doi:10.1023/B:VISI.0000029664.99615.94
    """

    Config = MutualRatioConfig
    config: MutualRatioConfig

    def process(self, inputs: FeaturesMatching2DInputs) -> FeaturesMatching2DOutputs:
        """Return the matches; raises InputError where the inputs do not fit."""
        c = self.config
        source, sink = np.asarray(inputs.source), np.asarray(inputs.sink)
        if source.ndim != 2 or sink.ndim != 2 or source.shape[1] != sink.shape[1]:
            raise InputError(f"descriptors {source.shape} and {sink.shape}: expected (n, d) and (m, d)")
        if not (len(source) and len(sink)):
            return FeaturesMatching2DOutputs(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0))
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
                ratios = ratios**2  # these are distances already, not squares
        keep = (first < _FAR) & (ratios <= c.max_ratio)
        if c.mutual:
            keep &= back[nearest] == rows
        chosen = np.flatnonzero(keep)
        chosen = chosen[np.argsort(ratios[chosen], kind="stable")[: c.max_matches]]
        distances = first if self._hamming(source) else np.sqrt(first)
        return FeaturesMatching2DOutputs(
            np.column_stack([chosen, nearest[chosen]]).astype(np.int64), distances[chosen], ratios[chosen]
        )

    def _hamming(self, descriptors: NDArray[np.uint8]) -> bool:
        norm = self.config.norm
        return norm == "hamming" or (norm == "auto" and descriptors.shape[1] == 32)

    def _squared(self, source: NDArray[np.uint8], sink: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Squared Euclidean, or Hamming, distances ``(n, m)``."""
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

    def _near_lines(self, inputs: FeaturesMatching2DInputs, n: int, m: int) -> NDArray[np.bool_]:
        """Pairs ``(n, m)`` within the band of the fundamental matrix, by Sampson's distance."""
        F = np.asarray(inputs.fundamental_matrix, np.float64)
        if inputs.source_features is None or inputs.sink_features is None:
            raise InputError("fundamentalMatrix without sourceFeatures and sinkFeatures: expected all three")
        if inputs.source_features.shape != (n, 2) or inputs.sink_features.shape != (m, 2) or F.shape != (3, 3):
            shapes = f"{inputs.source_features.shape}, {inputs.sink_features.shape}, F {F.shape}"
            raise InputError(f"points {shapes}: expected ({n}, 2), ({m}, 2), (3, 3)")
        x = homogeneous(np.asarray(inputs.source_features, np.float64))
        y = homogeneous(np.asarray(inputs.sink_features, np.float64))
        lines, back = x @ F.T, y @ F
        near = np.empty((n, m), bool)
        for low in range(0, n, _BLOCK_ROWS):
            block = lines[low : low + _BLOCK_ROWS]
            steep = (block[:, :2] ** 2).sum(axis=1)[:, None] + (back[:, :2] ** 2).sum(axis=1)
            near[low : low + len(block)] = (block @ y.T) ** 2 <= self.config.band_px**2 * steep
        return near
