# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Last confirmed mission time of a store, with which the clock is compared after a restart."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from cdff_common.clock import NS_PER_S
from dpm_store.engine.database import Database
from dpm_store.engine.notes import read_note, write_note

_NAME = "clock_reference"


@dataclass(frozen=True, slots=True)
class ClockReference:
    """Mission time at a time of the wall clock.

    Attributes
    ----------
    mission_ns, wall_ns : int
    rate : float
        Mission seconds in a second.
    is_published : bool
        Mission time was published on the bus; else it was the wall clock.
    """

    mission_ns: int
    wall_ns: int
    rate: float
    is_published: bool

    def jump_s(self, mission_ns: int, wall_ns: int) -> float:
        """Return a mission time minus the extrapolated one, seconds."""
        elapsed_ns = (wall_ns - self.wall_ns) * self.rate
        return (mission_ns - self.mission_ns - elapsed_ns) / NS_PER_S


def read_clock_reference(database: Database) -> ClockReference | None:
    """Return the reference; None for a new store."""
    value = read_note(database, _NAME)
    return None if value is None else ClockReference(**value)


def write_clock_reference(database: Database, reference: ClockReference) -> None:
    """Replace the reference; raises StorageError."""
    write_note(database, _NAME, asdict(reference))
