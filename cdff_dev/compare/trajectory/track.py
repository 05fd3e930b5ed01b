# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory with stamps and covariances, for comparisons."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Poses of one object at ascending times.

    Attributes
    ----------
    name : str
        Name for messages.
    stamps_ns : ndarray of int64, shape (n,)
    matrices : ndarray, shape (n, 4, 4)
        ``T_parent_child``, metres.
    covariances : ndarray, shape (n, 6, 6), or None
        Order x y z rx ry rz, perturbation in the parent; rows of NaN where unknown.
    dropped : int
        Poses of the file that are not in the track because their stamps are repeated or not in order.
    """

    name: str
    stamps_ns: NDArray[np.int64]
    matrices: Float
    covariances: Float | None = None
    dropped: int = 0

    @classmethod
    def of_ascending(
        cls, name: str, stamps_ns: NDArray[np.int64], matrices: Float, covariances: Float | None = None
    ) -> Track:
        """Return the track without the fewest poses that leave ascending stamps; ``dropped`` is their number.

        Of poses with the same stamp the first one is kept.
        """
        is_kept = np.ones(len(stamps_ns), np.bool_)
        if np.any(np.diff(stamps_ns) <= 0):
            is_kept[:] = False
            is_kept[_longest_ascending(stamps_ns.tolist())] = True
        if covariances is not None:
            covariances = covariances[is_kept]
        return cls(name, stamps_ns[is_kept], matrices[is_kept], covariances, int(np.sum(~is_kept)))

    def __post_init__(self) -> None:
        if len(self.stamps_ns) != len(self.matrices) or not len(self.stamps_ns):
            raise InputError(
                f"{self.name}: {len(self.matrices)} poses at {len(self.stamps_ns)} times, expected at least "
                "one pose and equal numbers"
            )
        if np.any(np.diff(self.stamps_ns) <= 0):
            row = int(np.argmax(np.diff(self.stamps_ns) <= 0)) + 1
            raise InputError(
                f"{self.name}: pose {row} is not later than the previous one; expected ascending times"
            )

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def positions_m(self) -> Float:
        """Positions ``(n, 3)``."""
        return self.matrices[:, :3, 3]

    @property
    def distances_m(self) -> Float:
        """Path length ``(n,)`` from the first pose to each pose, metres."""
        steps = np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def rows(self, index: NDArray[np.int64]) -> Track:
        """Return the track with the poses of the given rows."""
        covariances = None if self.covariances is None else self.covariances[index]
        return Track(self.name, self.stamps_ns[index], self.matrices[index], covariances, self.dropped)


def _longest_ascending(values: list[int]) -> list[int]:
    """Return the indices of a longest strictly ascending subsequence, by patience sorting.

    Fredman (1975), doi:10.1016/0012-365X(75)90103-X.
    """
    smallest: list[int] = []  # last value of the best subsequence of each length
    last: list[int] = []  # its index
    previous: list[int] = []
    for index, value in enumerate(values):
        length = bisect_left(smallest, value)
        previous.append(last[length - 1] if length else -1)
        if length == len(smallest):
            smallest.append(value)
            last.append(index)
        elif value < smallest[length]:  # of equal values the first one stays
            smallest[length], last[length] = value, index
    chosen, index = [], last[-1] if last else -1
    while index >= 0:
        chosen.append(index)
        index = previous[index]
    return chosen[::-1]
