# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A linear octree: the sorted Morton codes of the leaves that hold points."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.voxelization._interface import VoxelizationInputs, VoxelizationInterface, VoxelizationOutputs

Int = NDArray[np.int64]

_DEEPEST = 20


class OctreeConfig(DfnConfig):
    """Size of the leaves."""

    leaf_m: float = Field(0.25, gt=0.0, le=1000.0, description="Edge of a leaf, metres")


class Octree(VoxelizationInterface):
    """Leaves on multiples of their edge, in the order of a space-filling curve.

    Gargantini (1982), "An effective way to represent quadtrees", doi:10.1145/358728.358741, in three dimensions: a
    leaf's code interleaves the bits of its x, y and z, so that ancestors are prefixes and neighbours lie together.
    """

    Config: ClassVar[type[DfnConfig]] = OctreeConfig

    def process(self, inputs: VoxelizationInputs) -> VoxelizationOutputs:
        """Return the occupied leaves; raises InputError on a malformed cloud or too many levels."""
        p = checked_points(inputs.points)
        leaf_m = self.config.leaf_m
        cell = np.floor(p / leaf_m).astype(np.int64)
        low = cell.min(axis=0)
        depth = int(int((cell - low).max()).bit_length())
        if depth > _DEEPEST:
            raise InputError(f"leaf_m={leaf_m}: {depth} levels for {np.ptp(p, axis=0)} m, at most {_DEEPEST}")
        codes, row, counts = np.unique(_interleaved(cell - low), return_inverse=True, return_counts=True)
        means = np.stack([np.bincount(row, weights=p[:, axis]) / counts for axis in range(3)], axis=1)
        first = np.empty(len(codes), np.int64)
        first[row] = np.arange(len(p))
        return VoxelizationOutputs(
            codes=codes,
            centres=(cell[first] + 0.5) * leaf_m,
            means=means,
            counts=counts.astype(np.int64),
            origin_m=low * leaf_m,
            depth=np.array(depth),
        )


def _interleaved(cell: Int) -> Int:
    """Morton codes ``(n,)`` of cells ``(n, 3)`` below 2^20: bits of x, y, z in turns, x the highest of three."""
    codes = np.zeros(len(cell), np.int64)
    for axis in range(3):
        v = cell[:, axis].copy()
        for shift, mask in (
            (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):  # fmt: skip
            v = (v | (v << shift)) & mask
        codes |= v << (2 - axis)
    return codes
