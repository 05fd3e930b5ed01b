# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The revisioned tree of fixed frames: a correction is one more row, and what was believed before can be asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Row, and_, func, insert, or_, select

from cdff_common.clock import Clock
from cdff_common.errors import ConflictError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, UncertainTransform, checked_frame
from dpm_store import schema
from dpm_store.arrays import pack, unpack
from dpm_store.database import Database

_MAX_DEPTH = 64
#: Made once: every search by region asks for its own frame in itself.
IDENTITY = UncertainTransform.identity()


@dataclass(frozen=True, slots=True)
class FrameRevision:
    """One revision of the edge from ``parent`` to ``frame``.

    Attributes
    ----------
    T_parent_frame : UncertainTransform
    valid_from_ns, valid_until_ns : int or None
        Capture times it holds for; None where it is open.
    inserted_ns : int
        When the store learned it, mission time.
    """

    frame: str
    revision: int
    parent: str
    T_parent_frame: UncertainTransform
    valid_from_ns: int | None
    valid_until_ns: int | None
    inserted_ns: int
    producer: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data for MessagePack and JSON."""
        c = self.T_parent_frame.covariance
        return {
            "frame": self.frame, "revision": self.revision, "parent": self.parent,
            "T": self.T_parent_frame.matrix.tolist(), "covariance": None if c is None else c.tolist(),
            "valid_from_ns": self.valid_from_ns, "valid_until_ns": self.valid_until_ns,
            "inserted_ns": self.inserted_ns, "producer": self.producer,
        }  # fmt: skip


class FrameTable:
    """Fixed edges of the frame tree."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def set(
        self,
        frame: str,
        parent: str,
        T_parent_frame: UncertainTransform,
        *,
        valid_from_ns: int | None = None,
        valid_until_ns: int | None = None,
        producer: str = "",
        expected_revision: int | None = None,
    ) -> FrameRevision:
        """Add a revision: every product of ``frame`` and of the frames below moves with it.

        Parameters
        ----------
        expected_revision : int, optional
            The revision the caller has seen (0 for none); another one in the store is a conflict.

        Raises
        ------
        InputError
            If the edge would close a loop, or the validity is empty.
        ConflictError
            If somebody else revised the frame first.
        """
        checked_frame(frame)
        checked_frame(parent, "parent")
        if valid_from_ns is not None and valid_until_ns is not None and valid_from_ns >= valid_until_ns:
            raise InputError(f"frame {frame}: validity {valid_from_ns}..{valid_until_ns} is empty")
        with self._database.write() as connection:
            last = self._last_revision(connection, frame)
            if expected_revision is not None and expected_revision != last:
                raise ConflictError(f"frame {frame} is at revision {last}, not {expected_revision}; read it again")
            if frame in self._chain(connection, parent, None, None):
                raise InputError(f"{parent} is below {frame}: the edge would close a loop")
            now_ns = self._clock.now_ns()
            row = {
                "frame": frame, "revision": last + 1, "parent": parent, **pack(T_parent_frame),
                "valid_from_ns": valid_from_ns, "valid_until_ns": valid_until_ns,
                "inserted_ns": now_ns, "producer": producer,
            }  # fmt: skip
            connection.execute(insert(schema.frames), row)
        return FrameRevision(frame, last + 1, parent, T_parent_frame, valid_from_ns, valid_until_ns, now_ns, producer)

    def revisions(self, frame: str) -> tuple[FrameRevision, ...]:
        """All revisions of a frame, oldest first; raises FrameNotFoundError if there is none."""
        with self._database.read() as connection:
            rows = connection.execute(
                select(schema.frames).where(schema.frames.c.frame == frame).order_by(schema.frames.c.revision)
            ).all()
        if not rows:
            raise FrameNotFoundError(f"frame {frame!r} has no fixed edge in the store")
        return tuple(_revision(row) for row in rows)

    def current(self, as_of_ns: int | None = None) -> tuple[FrameRevision, ...]:
        """The last revision of every frame, as known at ``as_of_ns``; by name."""
        f = schema.frames.c
        known = select(f.frame, func.max(f.revision).label("revision")).group_by(f.frame)
        if as_of_ns is not None:
            known = known.where(f.inserted_ns <= as_of_ns)
        newest = known.subquery()
        statement = select(schema.frames).join(newest, and_(f.frame == newest.c.frame, f.revision == newest.c.revision))
        with self._database.read() as connection:
            return tuple(_revision(row) for row in connection.execute(statement.order_by(f.frame)))

    def lookup(
        self, parent: str, child: str, stamp_ns: int | None = None, as_of_ns: int | None = None
    ) -> UncertainTransform:
        """``T_parent_child`` over fixed edges; raises FrameNotFoundError where no chain of them joins the two.

        Parameters
        ----------
        stamp_ns : int, optional
            Capture time the edges must be valid at; default: newest revision whatever its validity.
        as_of_ns : int, optional
            Use only revisions that the store knew by then.
        """
        with self._database.read() as connection:
            return self.lookup_in(connection, parent, child, stamp_ns, as_of_ns)

    def lookup_in(
        self, connection: Connection, parent: str, child: str, stamp_ns: int | None = None, as_of_ns: int | None = None
    ) -> UncertainTransform:
        """As ``lookup``, inside a transaction."""
        if parent == child:
            return IDENTITY
        graph = FrameGraph()
        for frame in (parent, child):
            for name, edge in self._chain(connection, frame, stamp_ns, as_of_ns).items():
                if edge is not None:
                    graph.set_static(edge.parent, name, edge.T_parent_frame)
        return graph.lookup(parent, child, stamp_ns or 0)

    def _chain(
        self, connection: Connection, frame: str, stamp_ns: int | None, as_of_ns: int | None
    ) -> dict[str, FrameRevision | None]:
        """The frame and all above it with the edge that leads up; None at the top."""
        chain: dict[str, FrameRevision | None] = {}
        name = frame
        while name not in chain and len(chain) < _MAX_DEPTH:
            chain[name] = edge = self.edge_in(connection, name, stamp_ns, as_of_ns)
            if edge is None:
                break
            name = edge.parent
        return chain

    def edge_in(
        self, connection: Connection, frame: str, stamp_ns: int | None, as_of_ns: int | None
    ) -> FrameRevision | None:
        """The revision of a frame's fixed edge that holds at a capture time, inside a transaction; None without."""
        f = schema.frames.c
        statement = select(schema.frames).where(f.frame == frame)
        if as_of_ns is not None:
            statement = statement.where(f.inserted_ns <= as_of_ns)
        if stamp_ns is not None:
            statement = statement.where(
                or_(f.valid_from_ns.is_(None), f.valid_from_ns <= stamp_ns),
                or_(f.valid_until_ns.is_(None), f.valid_until_ns > stamp_ns),
            )
        row = connection.execute(statement.order_by(f.revision.desc()).limit(1)).first()
        return None if row is None else _revision(row)

    @staticmethod
    def _last_revision(connection: Connection, frame: str) -> int:
        f = schema.frames.c
        last: int | None = connection.execute(select(func.max(f.revision)).where(f.frame == frame)).scalar_one()
        return last or 0


def _revision(row: Row[Any]) -> FrameRevision:
    return FrameRevision(
        row.frame, row.revision, row.parent, unpack(row.matrix, row.covariance), row.valid_from_ns,
        row.valid_until_ns, row.inserted_ns, row.producer,
    )  # fmt: skip
