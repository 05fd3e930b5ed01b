# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies and what lies on them: an anchored site is a fixed frame below its body's, so that correcting it is one more
revision like any other, and sites of one body are joined through it.
"""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
from sqlalchemy import Connection, func, insert, select

from cdff_common.clock import Clock
from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, Body, Place, body, body_names
from cdff_common.geometry import UncertainTransform
from dpm_store import schema
from dpm_store.database import Database
from dpm_store.events import EventTable
from dpm_store.frames import EVERYTHING, FrameRevision, FrameTable, Known


class Places:
    """Bodies of the store and anchors on them."""

    def __init__(self, database: Database, frames: FrameTable, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._frames = frames
        self._events = events
        self._clock = clock

    def define(self, new: Body, producer: str = "") -> int:
        """Enter a body, or a new revision of one; returns the revision, the present one where nothing differs.

        Raises
        ------
        InputError
            If a frame that is no body has the name.
        """
        with self._database.write() as connection:
            return self._define_in(connection, new, producer)

    def bodies(self, known: Known = EVERYTHING) -> dict[str, Body]:
        """The bodies that were entered or anchored on, by name, in their last revision."""
        with self._database.read() as connection:
            return _stored(connection, known)

    def body(self, name: str, known: Known = EVERYTHING) -> Body:
        """A body as it was entered, else as the registry has it; raises ConfigurationError for an unknown one."""
        return self.bodies(known).get(name) or body(name)

    def anchor(
        self, frame: str, place: Anchor, *, sigma_m: float = 0.0, sigma_deg: float = 0.0, producer: str = "",
        expected_revision: int | None = None,
    ) -> FrameRevision:  # fmt: skip
        """Place a frame on a body: one frame revision, with everything that lies in the frame or below.

        Parameters
        ----------
        sigma_m, sigma_deg : float
            One standard deviation per axis of position and direction.
        expected_revision : int, optional
            As of ``FrameTable.set``.
        """
        if not (0.0 <= sigma_m < np.inf and 0.0 <= sigma_deg < np.inf):
            raise InputError(f"anchor of {frame}: sigma {sigma_m} m, {sigma_deg} deg, expected 0 or more")
        variances = np.square([sigma_m] * 3 + [np.deg2rad(sigma_deg)] * 3)
        T = UncertainTransform(place.T_body_frame, np.diag(variances))
        with self._database.write() as connection:
            self._define_in(connection, place.body, producer)
            return self._frames.set_in(
                connection, frame, place.body.name, T, producer=producer, expected_revision=expected_revision
            )

    def of(self, frame: str, known: Known = EVERYTHING) -> Place:
        """Where a frame is, by fixed edges; a frame that none joins with a body is a place of its own.

        One that is joined with a body and lies at its centre, or too far out to be near its surface, has no anchor.
        """
        with self._database.read() as connection:
            return self.of_in(connection, frame, known)

    def of_in(self, connection: Connection, frame: str, known: Known = EVERYTHING) -> Place:
        """As ``of``, inside a transaction."""
        tree = self._frames.tree_in(connection, known)
        root = tree.root_of(frame)
        found = _stored(connection, known).get(root)
        if found is None and root in body_names():
            found = body(root)
        if found is None:
            return Place(frame, frames_revision=tree.state)
        T = tree.find(root, frame)
        if found.crs is None or frame == root or T is None:
            return Place(frame, found, None, tree.state)
        try:
            anchor = Anchor.from_transform(found, T.matrix)
        except InputError:  # at the body's centre, far out in space: nowhere on its surface
            anchor = None
        return Place(frame, found, anchor, tree.state)

    def _define_in(self, connection: Connection, new: Body, producer: str) -> int:
        b, f = schema.bodies.c, schema.frames.c
        last: int = connection.execute(select(func.max(b.revision)).where(b.name == new.name)).scalar_one() or 0
        if last and _stored(connection, EVERYTHING)[new.name] == new:
            return last
        if connection.execute(select(f.frame).where(f.frame == new.name).limit(1)).first() is not None:
            raise InputError(f"body {new.name}: a frame of that name lies below another; a body is at the top")
        now_ns = self._clock.now_ns()
        row = {
            "name": new.name, "revision": last + 1, "definition": msgpack.packb(new.to_dict()), "inserted_ns": now_ns,
            "producer": producer,
        }  # fmt: skip
        connection.execute(insert(schema.bodies), row)
        body_said: dict[str, Any] = {"body": new.name, "kind": new.kind, "revision": last + 1}
        self._events.append_in(connection, "ground", "body_defined", body_said, now_ns)
        return last + 1


def _stored(connection: Connection, known: Known) -> dict[str, Body]:
    b = schema.bodies.c
    statement = select(schema.bodies).order_by(b.name, b.revision)
    if known.as_of_ns is not None:
        statement = statement.where(b.inserted_ns <= known.as_of_ns)
    return {row.name: Body.from_dict(msgpack.unpackb(row.definition)) for row in connection.execute(statement)}
