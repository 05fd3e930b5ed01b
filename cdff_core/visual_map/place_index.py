# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Index of keyframes by the similarity of their descriptors, without learned weights."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from scipy.cluster.vq import kmeans2

from cdff_common.arrays import ByteArray, FloatArray, IntArray

_TRAINING_ROWS = 20_000
_ITERATIONS = 10


class PlaceIndex:
    """Index of keyframes by one vector each: locally aggregated descriptors (VLAD [1]_).

    The clusters are those of the descriptors of the map. Residuals are normalised within each cluster [2]_, so that a repeated structure does not dominate.

    References
    ----------
    .. [1] H. Jegou et al., Aggregating Local Descriptors into a Compact Image Representation, CVPR 2010,
       doi:10.1109/CVPR.2010.5540039
    .. [2] R. Arandjelovic, A. Zisserman, All About VLAD, CVPR 2013, doi:10.1109/CVPR.2013.207
    """

    def __init__(self, keyframes: Sequence[ByteArray], clusters: int, seed: int) -> None:
        described = [rows for rows in keyframes if len(rows)]
        rows = np.concatenate(described) if described else np.zeros((0, 1), np.uint8)
        generator = np.random.default_rng(seed)
        if len(rows) > _TRAINING_ROWS:
            rows = rows[np.sort(generator.choice(len(rows), _TRAINING_ROWS, replace=False))]
        self._centres = np.zeros((0, rows.shape[1]), np.float32)
        if len(rows):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # empty clusters keep their centres
                self._centres, _ = kmeans2(
                    rows.astype(np.float32),
                    min(clusters, len(rows)),
                    iter=_ITERATIONS,
                    minit="points",
                    rng=generator,
                )
        self._vectors = np.array([self._vector(rows) for rows in keyframes], np.float32)

    def nearest(self, descriptors: ByteArray, count: int) -> IntArray:
        """Return the rows of the most similar keyframes, best first."""
        if not len(self._centres) or not len(descriptors):
            return np.zeros(0, np.int64)
        similarity = self._vectors @ self._vector(descriptors)
        return np.argsort(-similarity, kind="stable")[:count]

    def _vector(self, descriptors: ByteArray) -> FloatArray:
        """Return the unit vector (k d,) of an image; zeros without descriptors."""
        sums = np.zeros_like(self._centres)
        if len(descriptors):
            rows = descriptors.astype(np.float32)
            nearest = np.argmax(2.0 * rows @ self._centres.T - (self._centres**2).sum(axis=1), axis=1)
            np.add.at(sums, nearest, rows - self._centres[nearest])
            sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)
        vector = sums.ravel()
        return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))
