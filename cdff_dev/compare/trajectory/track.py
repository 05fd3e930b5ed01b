# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory with stamps and covariances, for comparisons."""

from __future__ import annotations

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
        """Return the track without the poses whose stamp is repeated or earlier than a previous one.

        ``dropped`` is their number.
        """
        latest_ns = np.maximum.accumulate(stamps_ns[:-1])
        kept = np.concatenate([np.ones(min(len(stamps_ns), 1), np.bool_), stamps_ns[1:] > latest_ns])
        if covariances is not None:
            covariances = covariances[kept]
        return cls(name, stamps_ns[kept], matrices[kept], covariances, int(np.sum(~kept)))

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
