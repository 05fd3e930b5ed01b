# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sparse voxel grid: blocks of 8 x 8 x 8 voxels that are stored where a surface was observed."""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

from cdff_common.arrays import Float32Array, FloatArray, IntArray
from cdff_core.dfns.surface_fusion._kernels import CountArray

#: Voxels along the edge of a block, and in a block.
SIDE = 8
VOXELS = SIDE**3
#: Bits of each of the three coordinates in a key of 64 bits.
_BITS = 21
_OFFSET = 1 << (_BITS - 1)
#: Steps from a block to its 26 neighbours and itself, in the order of ``neighbours``.
_STEPS = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], np.int64)


class VoxelBlocks:
    """Blocks by their integer coordinates, with the statistics of each voxel.

    Attributes
    ----------
    distances, weights, scatters : NDArray[np.float32], shape (capacity, 512)
        Weighted mean of the signed distances, sum of the weights, and weighted sum of squared deviations.
    views : NDArray[np.uint16], shape (capacity, 512)
    colors : NDArray[np.float32], shape (capacity, 512, 4)
        Weighted mean of red, green, blue, and the sum of its weights.
    """

    def __init__(self, max_blocks: int) -> None:
        self._max_blocks = max_blocks
        self._keys = np.zeros(0, np.int64)
        self._slots = np.zeros(0, np.int64)
        self._resize(256)

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, coordinates: IntArray) -> tuple[IntArray, IntArray, int]:
        """Store the blocks that are new, up to the limit.

        Returns
        -------
        coordinates : (m, 3)
            Distinct blocks that are stored.
        slots : (m,)
        rejected : int
            Number of blocks beyond the limit.
        """
        keys = np.unique(_keys(coordinates))
        new_keys = np.setdiff1d(keys, self._keys, assume_unique=True)
        room = self._max_blocks - len(self)
        added_keys = new_keys[:room]
        if len(added_keys):
            n = len(self)
            if n + len(added_keys) > len(self.weights):
                self._resize(min(max(2 * len(self.weights), n + len(added_keys)), self._max_blocks))
            merged = np.concatenate([self._keys, added_keys])
            slots = np.concatenate([self._slots, n + np.arange(len(added_keys))])
            order = np.argsort(merged, kind="stable")
            self._keys, self._slots = merged[order], slots[order]
        slots = self._find(keys)
        is_stored = slots >= 0
        return _coordinates(keys[is_stored]), slots[is_stored], len(new_keys) - len(added_keys)

    def all(self) -> tuple[IntArray, IntArray]:
        """Return the coordinates ``(m, 3)`` and slots ``(m,)`` of all blocks."""
        return _coordinates(self._keys), self._slots

    def neighbours(self) -> tuple[IntArray, IntArray]:
        """Return the coordinates ``(m, 3)`` and the slots ``(m, 27)`` around each, -1 if absent.

        Blocks are in the order of their slots.
        """
        order = np.argsort(self._slots)
        coordinates = _coordinates(self._keys[order])
        around = coordinates[:, None, :] + _STEPS
        return coordinates, self._find(_keys(around.reshape(-1, 3))).reshape(-1, len(_STEPS))

    def _find(self, keys: IntArray) -> IntArray:
        if not len(self):
            return np.full(len(keys), -1)
        positions = np.minimum(np.searchsorted(self._keys, keys), len(self) - 1)
        return np.where(self._keys[positions] == keys, self._slots[positions], -1)

    def _resize(self, capacity: int) -> None:
        """Give each array room for ``capacity`` blocks; existing blocks keep their values."""
        shapes: dict[str, tuple[tuple[int, ...], DTypeLike]] = {
            "distances": ((), np.float32),
            "weights": ((), np.float32),
            "scatters": ((), np.float32),
            "views": ((), np.uint16),
            "colors": ((4,), np.float32),
        }
        for name, (shape, dtype) in shapes.items():
            grown = np.zeros((capacity, VOXELS, *shape), dtype)
            if len(self):
                grown[: len(self)] = getattr(self, name)[: len(self)]
            setattr(self, name, grown)

    distances: Float32Array
    weights: Float32Array
    scatters: Float32Array
    views: CountArray
    colors: Float32Array


def is_representable(coordinates: FloatArray) -> bool:
    """Return True if block coordinates, with their neighbours, fit the keys."""
    return bool((np.abs(coordinates) < _OFFSET - 2).all())


def _keys(coordinates: IntArray) -> IntArray:
    shifted = coordinates + _OFFSET
    return np.asarray((shifted[:, 0] << 2 * _BITS) | (shifted[:, 1] << _BITS) | shifted[:, 2])


def _coordinates(keys: IntArray) -> IntArray:
    mask = (1 << _BITS) - 1
    return np.stack([keys >> 2 * _BITS, (keys >> _BITS) & mask, keys & mask], axis=1) - _OFFSET
