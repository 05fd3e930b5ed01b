# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robots: what is known of them beside their products."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgpack
from sqlalchemy import insert, select, update

from cdff_common.clock import Clock
from dpm_store import schema
from dpm_store.database import Database
from dpm_store.events import EventTable


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """A robot.

    Attributes
    ----------
    robot : str
        Its id.
    doc : str
        In words.
    description : mapping
        Plain data: sensors, limits, frames, DFPCs, as its mission's profile has them.
    inserted_ns, updated_ns : int
        When the store learned of it, and of the description that it has now.
    """

    robot: str
    doc: str
    description: Mapping[str, Any]
    inserted_ns: int
    updated_ns: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data for MessagePack and JSON."""
        return {
            "robot": self.robot, "doc": self.doc, "description": dict(self.description),
            "inserted_ns": self.inserted_ns, "updated_ns": self.updated_ns,
        }  # fmt: skip


class RobotTable:
    """Robots that were described; what they had before is in the history."""

    def __init__(self, database: Database, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._events = events
        self._clock = clock

    def describe(self, robot: str, doc: str, description: Mapping[str, Any]) -> bool:
        """Enter a robot, or what it is now; the event ``robot_described`` keeps each description. False if known."""
        r, packed, now_ns = schema.robots.c, msgpack.packb(dict(description)), self._clock.now_ns()
        with self._database.write() as connection:
            row = connection.execute(select(schema.robots).where(r.robot == robot)).first()
            if row is not None and (row.doc, row.description) == (doc, packed):
                return False
            said = {"doc": doc, "description": packed, "updated_ns": now_ns}
            if row is None:
                connection.execute(insert(schema.robots), {"robot": robot, "inserted_ns": now_ns, **said})
            else:
                connection.execute(update(schema.robots).where(r.robot == robot).values(said))
            body = {"doc": doc, "description": dict(description)}
            self._events.append_in(connection, robot, "robot_described", body, now_ns)
        return True

    def all(self) -> tuple[RobotRecord, ...]:
        """Every robot that was described, by name."""
        with self._database.read() as connection:
            rows = connection.execute(select(schema.robots).order_by(schema.robots.c.robot)).all()
        return tuple(
            RobotRecord(row.robot, row.doc, msgpack.unpackb(row.description), row.inserted_ns, row.updated_ns)
            for row in rows
        )
