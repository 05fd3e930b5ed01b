# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Celestial bodies and frames that are anchored on them.

An anchored site is a fixed frame below the frame of its body: a correction is an ordinary frame revision, and
the frame of the body connects its sites.
"""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
from sqlalchemy import Connection, func, insert, select

from cdff_common.clock import Clock
from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, Body, FrameLocation, body, body_names
from cdff_common.geometry import UncertainTransform
from dpm_store.engine import schema
from dpm_store.engine.array_columns import pack
from dpm_store.engine.database import Database, dialect_of
from dpm_store.frames.frames import LATEST, FrameRevision, FrameTable, HistoryView
from dpm_store.history.events import EventTable

_DEFINITIONS = select(func.count()).select_from(schema.bodies)


class AnchorTable:
    """Bodies and the anchors of frames on them."""

    def __init__(self, database: Database, frames: FrameTable, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._frames = frames
        self._events = events
        self._clock = clock

    def define(self, definition: Body, producer: str = "", *, connection: Connection | None = None) -> int:
        """Define a body or a new revision of it; return its number; an equal definition adds no revision.

        Raises
        ------
        InputError
            If a frame below another frame has the name.
        """
        with self._database.write(connection) as connection:
            b, f = schema.bodies.c, schema.frames.c
            last: int = (
                connection.execute(select(func.max(b.revision)).where(b.name == definition.name)).scalar_one()
                or 0
            )
            if last and _stored_bodies(connection, LATEST)[definition.name] == definition:
                return last
            if (
                connection.execute(select(f.frame).where(f.frame == definition.name).limit(1)).first()
                is not None
            ):
                raise InputError(
                    f"body {definition.name}: a frame of that name is below another frame; a body is a root"
                )
            now_ns = self._clock.now_ns()
            row = {
                "name": definition.name,
                "revision": last + 1,
                "definition": msgpack.packb(definition.to_dict()),
                "inserted_ns": now_ns,
                "producer": producer,
            }
            connection.execute(insert(schema.bodies), row)
            event: dict[str, Any] = {"body": definition.name, "kind": definition.kind, "revision": last + 1}
            self._events.append("ground", "body_defined", event, now_ns, connection=connection)
            return last + 1

    def bodies(self, view: HistoryView = LATEST) -> dict[str, Body]:
        """Return the bodies that are defined or have anchors, by name, in their last revision."""
        with self._database.read() as connection:
            return _stored_bodies(connection, view)

    def revision(self) -> int:
        """Return the number of definitions of bodies, which grows with every change."""
        with self._database.read() as connection:
            ((count,),) = dialect_of(connection).fetch(connection, _DEFINITIONS)
            return int(count)

    def body(self, name: str, view: HistoryView = LATEST) -> Body:
        """Return a body as defined here, else from the registry; raises ConfigurationError if unknown."""
        return self.bodies(view).get(name) or body(name)

    def anchor(
        self,
        frame: str,
        location: Anchor,
        *,
        sigma_m: float = 0.0,
        sigma_deg: float = 0.0,
        producer: str = "",
        expected_revision: int | None = None,
    ) -> FrameRevision:
        """Anchor a frame on a body by a new frame revision; an equal anchor adds none.

        Parameters
        ----------
        sigma_m, sigma_deg : float
            Standard deviation of the position and of the orientation, per axis.
        expected_revision : int, optional
            See ``FrameTable.set``.
        """
        if not (0.0 <= sigma_m < np.inf and 0.0 <= sigma_deg < np.inf):
            raise InputError(f"anchor of {frame}: sigma {sigma_m} m, {sigma_deg} deg, expected 0 or more")
        variances = np.square([sigma_m] * 3 + [np.deg2rad(sigma_deg)] * 3)
        T = UncertainTransform(location.T_body_frame, np.diag(variances))
        with self._database.write() as connection:
            self.define(location.body, producer, connection=connection)
            last = self._frames.edge_in(connection, frame, None)
            if (
                last is not None
                and expected_revision in (None, last.revision)
                and _is_equal(last, location.body.name, T)
            ):
                return last
            return self._frames.set(
                frame,
                location.body.name,
                T,
                producer=producer,
                expected_revision=expected_revision,
                connection=connection,
            )

    def of(
        self, frame: str, view: HistoryView = LATEST, *, connection: Connection | None = None
    ) -> FrameLocation:
        """Return the location of a frame, by fixed edges.

        The location has no body if no fixed edges connect the frame with one, and no anchor at the centre of
        the body or far from its surface.
        """
        with self._database.read(connection) as connection:
            tree = self._frames.tree(view, connection=connection)
            root = tree.chain(frame)[-1]
            root_body = _stored_bodies(connection, view).get(root)
            if root_body is None and root in body_names():
                root_body = body(root)
            if root_body is None:
                return FrameLocation(frame, frames_revision=tree.state)
            T = tree.find(root, frame)
            if root_body.crs is None or frame == root or T is None:
                return FrameLocation(frame, root_body, None, tree.state)
            try:
                anchor = Anchor.from_transform(root_body, T.matrix)
            except InputError:  # at the centre of the body or far from its surface
                anchor = None
            return FrameLocation(frame, root_body, anchor, tree.state)


def _is_equal(last: FrameRevision, parent: str, T: UncertainTransform) -> bool:
    """Return whether a revision is the transform from a parent, at any time of capture."""
    is_unlimited = (last.parent, last.valid_from_ns, last.valid_until_ns) == (parent, None, None)
    return is_unlimited and pack(last.T_parent_frame) == pack(T)


def _stored_bodies(connection: Connection, view: HistoryView) -> dict[str, Body]:
    b = schema.bodies.c
    statement = select(schema.bodies).order_by(b.name, b.revision)
    if view.as_of_ns is not None:
        statement = statement.where(b.inserted_ns <= view.as_of_ns)
    return {
        row.name: Body.from_dict(msgpack.unpackb(row.definition)) for row in connection.execute(statement)
    }
