# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A cloud prepared for registration: three levels of detail, each with its normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One level of detail.

    Attributes
    ----------
    points_m, normals : ndarray, shape (n, 3)
    """

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """The levels, coarsest first, and what they were made from.

    Attributes
    ----------
    levels : tuple of Level
    frame : str
    stamp_ns : int
    sample_id : str
    """

    levels: tuple[Level, ...]
    frame: str
    stamp_ns: int
    sample_id: str

    @property
    def fine(self) -> Level:
        """The finest level."""
        return self.levels[-1]
