# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Linear octree: the sorted Morton codes of the occupied leaves."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import IntArray
from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.voxelization.interface import Inputs, Interface, Outputs

#: Maximum number of levels, so that a Morton code has at most 60 bits.
_MAX_DEPTH = 20


class OctreeConfig(DfnConfig):
    """Parameters of Octree."""

    leaf_m: float = Field(0.25, gt=0, le=1000, description="Edge of a leaf")


class Octree(Interface[OctreeConfig]):
    """Assign points to leaves on multiples of their edge, and sort the leaves by Morton code.

    Gargantini (1982), "An effective way to represent quadtrees", doi:10.1145/358728.358741, in three
    dimensions: the code of a leaf interleaves the bits of its x, y and z indices, so that the code of an
    ancestor is a prefix and neighbours are close in the order.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the occupied leaves; raises InputError for a malformed cloud or too many levels."""
        p = checked_points(inputs.points)
        leaf_m = self.config.leaf_m
        cell = np.floor(p / leaf_m).astype(np.int64)
        lowest_cell = cell.min(axis=0)
        depth = int((cell - lowest_cell).max()).bit_length()
        if depth > _MAX_DEPTH:
            raise InputError(
                f"leaf_m={leaf_m}: {depth} levels for {np.ptp(p, axis=0)} m, expected at most {_MAX_DEPTH}"
            )
        codes, row, counts = np.unique(
            _morton_codes(cell - lowest_cell), return_inverse=True, return_counts=True
        )
        means = np.stack([np.bincount(row, weights=p[:, axis]) / counts for axis in range(3)], axis=1)
        point_of_leaf = np.empty(len(codes), np.int64)
        point_of_leaf[row] = np.arange(len(p))
        return Outputs(
            codes=codes,
            centres=np.asarray((cell[point_of_leaf] + 0.5) * leaf_m, np.float64),
            means=means,
            counts=counts.astype(np.int64),
            origin_m=lowest_cell * leaf_m,
            depth=depth,
        )


def _morton_codes(cell: IntArray) -> IntArray:
    """Return the Morton codes ``(n,)`` of cells ``(n, 3)`` below 2^20: interleaved bits, that of x first."""
    codes = np.zeros(len(cell), np.int64)
    for axis in range(3):
        v = cell[:, axis].copy()
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            v = (v | (v << shift)) & mask
        codes |= v << (2 - axis)
    return codes
