# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Last confirmed mission time of a store, with which the clock is compared after a restart."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from sqlalchemy import select

from cdff_common.clock import NS_PER_S
from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of

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
    m = schema.meta.c
    with database.read() as connection:
        text = connection.execute(select(m.value).where(m.name == _NAME)).scalar()
    return None if text is None else ClockReference(**json.loads(text))


def write_clock_reference(database: Database, reference: ClockReference) -> None:
    """Replace the reference; raises StorageError."""
    row = {"name": _NAME, "value": json.dumps(asdict(reference))}
    with database.write() as connection:
        dialect_of(connection).upsert_rows(connection, schema.meta, [row], replace=("value",))
