# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The star catalogue: directions, proper motions and magnitudes of the stars to magnitude 7.5.

``hipparcos2_hp75.csv.gz`` holds the 23 268 stars of the new reduction of the Hipparcos data [1]_ with a
magnitude Hp of at most 7.5, sorted by brightness. It is in the public domain (CDS, catalogue I/311).

References
----------
.. [1] van Leeuwen, F. (2007). Validation of the new Hipparcos reduction. Astronomy & Astrophysics 474.
   doi:10.1051/0004-6361:20078357
"""

from __future__ import annotations

import gzip
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.stars.aberration import aberrated
from cdff_common.types.validation import read_only

FloatArray = NDArray[np.float64]

#: File of the catalogue in this package.
CATALOGUE_FILE = "hipparcos2_hp75.csv.gz"
#: Epoch of the catalogue, J1991.25 (2 April 1991, 13:30 TT), and a Julian year; nanoseconds.
CATALOGUE_EPOCH_NS, YEAR_NS = 670_599_000_000_000_000, 31_557_600_000_000_000
_MAS_RAD = np.pi / 180.0 / 3_600_000.0


@dataclass(frozen=True, slots=True, eq=False)
class StarCatalogue:
    """Stars, sorted by brightness, the brightest first.

    Attributes
    ----------
    hip : NDArray[np.int64], shape (n,)
        Numbers of the Hipparcos catalogue.
    directions : NDArray[np.float64], shape (n, 3)
        Unit vectors, axes of the ICRS (equal to those of the GCRF), at ``epoch_ns``, seen from the barycentre
        of the solar system: without parallax and aberration.
    motions_rad_yr : NDArray[np.float64], shape (n, 3)
        Proper motions: velocities of the unit vectors, radians per Julian year.
    magnitudes : NDArray[np.float64], shape (n,)
        Magnitudes Hp.
    colours : NDArray[np.float64], shape (n,)
        Colour indices B - V.
    epoch_ns : int
        Time of the directions, nanoseconds since the UNIX epoch.
    """

    hip: NDArray[np.int64]
    directions: FloatArray
    motions_rad_yr: FloatArray
    magnitudes: FloatArray
    colours: FloatArray
    epoch_ns: int

    def __len__(self) -> int:
        return len(self.hip)

    def at(self, stamp_ns: int) -> StarCatalogue:
        """Return the catalogue with the directions at another time, by linear proper motion."""
        years = (stamp_ns - self.epoch_ns) / YEAR_NS
        moved_directions = self.directions + years * self.motions_rad_yr
        moved_directions /= np.linalg.norm(moved_directions, axis=1, keepdims=True)
        return replace(self, directions=read_only(moved_directions), epoch_ns=stamp_ns)

    def apparent(self, stamp_ns: int, velocity_m_s: ArrayLike) -> StarCatalogue:
        """Return the catalogue with the directions that an observer with a velocity ``(3,)`` sees at a time.

        The velocity is relative to the Sun, m/s, in inertial axes: that of the Earth plus that of the orbit.
        """
        catalogue_at_stamp = self.at(stamp_ns)
        return replace(
            catalogue_at_stamp, directions=read_only(aberrated(catalogue_at_stamp.directions, velocity_m_s))
        )

    def brighter_than(self, magnitude: float) -> StarCatalogue:
        """Return the stars whose magnitude is at most the given one."""
        return self.selected(np.arange(np.searchsorted(self.magnitudes, magnitude, side="right")))

    def selected(self, indices: ArrayLike) -> StarCatalogue:
        """Return the stars with the indices ``(k,)``, which keep the order of brightness if they ascend."""
        rows = np.asarray(indices, dtype=np.intp)
        return StarCatalogue(
            hip=read_only(self.hip[rows]),
            directions=read_only(self.directions[rows]),
            motions_rad_yr=read_only(self.motions_rad_yr[rows]),
            magnitudes=read_only(self.magnitudes[rows]),
            colours=read_only(self.colours[rows]),
            epoch_ns=self.epoch_ns,
        )

    def near(self, direction: ArrayLike, angle_rad: float) -> NDArray[np.intp]:
        """Return the ascending indices ``(k,)`` of the stars within an angle of a direction ``(3,)``.

        Raises
        ------
        InputError
            If the direction is not three finite values, not all zero.
        """
        axis = np.asarray(direction, dtype=float)
        length = float(np.linalg.norm(axis)) if axis.shape == (3,) else 0.0
        if not (np.isfinite(length) and length > 0.0):
            raise InputError(f"direction {direction!r}: expected three finite values, not all zero")
        # The chord avoids the poor resolution of the cosine of small angles.
        chord = 2.0 * np.sin(0.5 * min(max(angle_rad, 0.0), np.pi))
        return np.flatnonzero(((self.directions - axis / length) ** 2).sum(axis=1) <= chord**2)


@lru_cache(maxsize=1)
def load_catalogue() -> StarCatalogue:
    """Return the catalogue at its own epoch; its arrays are read-only."""
    with (files(__package__) / CATALOGUE_FILE).open("rb") as raw, gzip.open(raw) as text:
        table = np.loadtxt(text, delimiter=",", skiprows=1)
    ra, dec = np.radians(table[:, 1]), np.radians(table[:, 2])
    east = np.column_stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)])
    north = np.column_stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)])
    directions = np.column_stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    motions = (table[:, 4, None] * east + table[:, 5, None] * north) * _MAS_RAD
    return StarCatalogue(
        hip=read_only(table[:, 0].astype(np.int64)),
        directions=read_only(directions),
        motions_rad_yr=read_only(motions),
        magnitudes=read_only(table[:, 6].copy()),
        colours=read_only(table[:, 7].copy()),
        epoch_ns=CATALOGUE_EPOCH_NS,
    )
