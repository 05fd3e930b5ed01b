# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Index of keyframes by the similarity of their descriptors, without learned weights."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Sequence

import numpy as np
from scipy.cluster.vq import kmeans2

from cdff_common.arrays import ByteArray, Float32Array, IntArray

#: Largest number of descriptors from which the clusters are computed.
_TRAINING_ROWS = 20_000
#: Iterations of k-means.
_ITERATIONS = 10
#: Growth of the number of keyframes after which the clusters of the index are computed again.
_GROWTH = 4


class PlaceClusters:
    """Clusters of descriptors, and the vector of an image: locally aggregated descriptors (VLAD [1]_).

    Residuals are normalised within each cluster [2]_, so that a repeated structure does not dominate.

    References
    ----------
    .. [1] H. Jegou et al., Aggregating Local Descriptors into a Compact Image Representation, CVPR 2010,
       doi:10.1109/CVPR.2010.5540039
    .. [2] R. Arandjelovic, A. Zisserman, All About VLAD, CVPR 2013, doi:10.1109/CVPR.2013.207
    """

    def __init__(self, keyframes: Iterable[ByteArray], clusters: int, seed: int) -> None:
        described = [rows for rows in keyframes if len(rows)]
        rows = np.concatenate(described) if described else np.zeros((0, 1), np.uint8)
        generator = np.random.default_rng(seed)
        if len(rows) > _TRAINING_ROWS:
            rows = rows[np.sort(generator.choice(len(rows), _TRAINING_ROWS, replace=False))]
        self.centres = np.zeros((0, rows.shape[1]), np.float32)
        if len(rows):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # empty clusters keep their centres
                self.centres, _ = kmeans2(
                    rows.astype(np.float32),
                    min(clusters, len(rows)),
                    iter=_ITERATIONS,
                    minit="points",
                    rng=generator,
                )

    def vector(self, descriptors: ByteArray) -> Float32Array:
        """Return the unit vector (k d,) of an image; zeros without descriptors."""
        sums = np.zeros_like(self.centres)
        if len(descriptors) and len(self.centres):
            rows = descriptors.astype(np.float32)
            nearest = np.argmax(2.0 * rows @ self.centres.T - (self.centres**2).sum(axis=1), axis=1)
            members = (nearest[:, None] == np.arange(len(self.centres))).astype(np.float32)
            sums = members.T @ rows - members.sum(axis=0)[:, None] * self.centres
            sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)
        vector = sums.ravel()
        return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9), np.float32)


class PlaceIndex:
    """Index of the keyframes of a complete map; the clusters are those of its descriptors."""

    def __init__(self, keyframes: Sequence[ByteArray], clusters: int, seed: int) -> None:
        self._clusters = PlaceClusters(keyframes, clusters, seed)
        self._vectors = np.array([self._clusters.vector(rows) for rows in keyframes], np.float32)

    def nearest(self, descriptors: ByteArray, count: int) -> IntArray:
        """Return the rows of the most similar keyframes, best first."""
        if not len(self._clusters.centres) or not len(descriptors):
            return np.zeros(0, np.int64)
        similarity = self._vectors @ self._clusters.vector(descriptors)
        return np.argsort(-similarity, kind="stable")[:count]


class GrowingPlaceIndex:
    """Index of the keyframes of a map under construction, by their ids.

    The clusters are made again whenever the number of keyframes has grown fourfold.
    """

    def __init__(self, clusters: int, seed: int) -> None:
        self._count, self._seed = clusters, seed
        self.clear()

    def clear(self) -> None:
        """Remove all keyframes."""
        self._descriptors: dict[int, ByteArray] = {}
        self._vectors: dict[int, Float32Array] = {}
        self._clusters: PlaceClusters | None = None
        self._next_size = 1

    def __contains__(self, key: int) -> bool:
        return key in self._descriptors

    def insert(self, key: int, descriptors: ByteArray) -> None:
        """Add a keyframe."""
        self._descriptors[key] = descriptors
        if len(self._descriptors) >= self._next_size:
            self._next_size = _GROWTH * len(self._descriptors)
            self._clusters = PlaceClusters(self._descriptors.values(), self._count, self._seed)
            self._vectors = {k: self._clusters.vector(d) for k, d in self._descriptors.items()}
        elif self._clusters is not None:
            self._vectors[key] = self._clusters.vector(descriptors)

    def remove(self, key: int) -> None:
        """Remove a keyframe."""
        del self._descriptors[key], self._vectors[key]

    def nearest(self, descriptors: ByteArray, count: int, excluded: Collection[int] = ()) -> list[int]:
        """Return the ids of the most similar keyframes that are not excluded, best first."""
        keys = [key for key in self._vectors if key not in excluded]
        if self._clusters is None or not keys or not len(descriptors):
            return []
        similarity = np.array([self._vectors[key] for key in keys]) @ self._clusters.vector(descriptors)
        return [keys[row] for row in np.argsort(-similarity, kind="stable")[:count]]
