# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions of robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import msgpack
from sqlalchemy import select

from cdff_common.clock import Clock
from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of
from dpm_store.history.events import EventTable


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """Description of a robot.

    Attributes
    ----------
    robot : str
        Its id.
    doc : str
        Description in words.
    description : mapping
        Plain data of the mission's profile: sensors, limits, frames, DFPCs.
    inserted_ns, updated_ns : int
        Mission time of the first and of the present description.
    """

    robot: str
    doc: str
    description: Mapping[str, Any]
    inserted_ns: int
    updated_ns: int

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for MessagePack and JSON."""
        return asdict(self)


class RobotTable:
    """Present descriptions of robots; earlier ones are in the history."""

    def __init__(self, database: Database, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._events = events
        self._clock = clock

    def describe(self, robot: str, doc: str, description: Mapping[str, Any]) -> bool:
        """Set the description of a robot and append it as ``robot_described``; return False if unchanged."""
        r, packed, now_ns = schema.robots.c, msgpack.packb(dict(description)), self._clock.now_ns()
        with self._database.write() as connection:
            row = connection.execute(select(schema.robots).where(r.robot == robot)).first()
            if row is not None and (row.doc, row.description) == (doc, packed):
                return False
            new = {
                "robot": robot,
                "doc": doc,
                "description": packed,
                "inserted_ns": now_ns,
                "updated_ns": now_ns,
            }
            changing = ("doc", "description", "updated_ns")
            dialect_of(connection).upsert_rows(connection, schema.robots, [new], replace=changing)
            body = {"doc": doc, "description": dict(description)}
            self._events.append(robot, "robot_described", body, now_ns, connection=connection)
        return True

    def all(self) -> tuple[RobotRecord, ...]:
        """Return every robot, by name."""
        with self._database.read() as connection:
            rows = connection.execute(select(schema.robots).order_by(schema.robots.c.robot)).all()
        return tuple(
            RobotRecord(row.robot, row.doc, msgpack.unpackb(row.description), row.inserted_ns, row.updated_ns)
            for row in rows
        )
