# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The revisioned tree of fixed frames: a correction is one more row, and what was believed before can be asked for.

Every revision also takes a number in the order of all revisions, its state of the tree: naming that number brings back
the whole tree as it then was, whatever the clock said.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from sqlalchemy import ColumnElement, Connection, Row, and_, exists, func, insert, or_, select

from cdff_common.clock import Clock
from cdff_common.errors import ConflictError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, UncertainTransform, checked_frame
from dpm_store import schema, sqlite
from dpm_store.arrays import pack, unpack
from dpm_store.database import Database
from dpm_store.events import EventTable

_MAX_DEPTH = 64
#: A frame farther from its parent, some astronomical units, or known worse, would not leave numbers to calculate with.
FARTHEST_FRAME_M = 1e12
#: States of the tree kept ready; searches nearly always ask for the newest.
_CACHED_TREES = 8
#: Made once: every search by region asks for its own frame in itself.
IDENTITY = UncertainTransform.identity()


@dataclass(frozen=True, slots=True)
class Known:
    """What of the history counts; all of it where nothing is named.

    Attributes
    ----------
    as_of_ns : int or None
        Only what the store knew by then, mission time.
    state : int or None
        Only frame revisions up to this number.
    """

    as_of_ns: int | None = None
    state: int | None = None


#: Everything that is known.
EVERYTHING = Known()


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
    state : int
        Its number among all revisions of all frames.
    """

    frame: str
    revision: int
    parent: str
    T_parent_frame: UncertainTransform
    valid_from_ns: int | None
    valid_until_ns: int | None
    inserted_ns: int
    producer: str
    state: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Plain data for MessagePack and JSON."""
        c = self.T_parent_frame.covariance
        return {
            "frame": self.frame, "revision": self.revision, "parent": self.parent,
            "T": self.T_parent_frame.matrix.tolist(), "covariance": None if c is None else c.tolist(),
            "valid_from_ns": self.valid_from_ns, "valid_until_ns": self.valid_until_ns,
            "inserted_ns": self.inserted_ns, "producer": self.producer, "frames_revision": self.state,
        }  # fmt: skip


@dataclass(slots=True)
class FrameTree:
    """One state of the tree: the last revision of every frame, whatever its validity.

    Attributes
    ----------
    state : int
        Number of the newest revision in it, 0 without any.
    """

    state: int
    edges: dict[str, FrameRevision]
    _graph: FrameGraph = field(default_factory=FrameGraph)
    _found: dict[tuple[str, str], UncertainTransform | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for edge in self.edges.values():
            self._graph.set_static(edge.parent, edge.frame, edge.T_parent_frame)

    def find(self, parent: str, child: str) -> UncertainTransform | None:
        """``T_parent_child`` over fixed edges, or None where none join the two."""
        if parent == child:
            return IDENTITY
        key = (parent, child)
        if key not in self._found:
            try:
                self._found[key] = self._graph.lookup(parent, child, 0)
            except FrameNotFoundError:
                self._found[key] = None
        return self._found[key]

    def root_of(self, frame: str) -> str:
        """The frame at the top of a frame's chain; itself where nothing is above it."""
        while (edge := self.edges.get(frame)) is not None:
            frame = edge.parent
        return frame


class FrameTable:
    """Fixed edges of the frame tree."""

    def __init__(self, database: Database, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._events = events
        self._clock = clock
        self._trees: OrderedDict[tuple[int, Known], FrameTree] = OrderedDict()

    def set(
        self, frame: str, parent: str, T_parent_frame: UncertainTransform, *, valid_from_ns: int | None = None,
        valid_until_ns: int | None = None, producer: str = "", expected_revision: int | None = None,
    ) -> FrameRevision:  # fmt: skip
        """Add a revision: every product of ``frame`` and of the frames below moves with it.

        The event ``reanchored`` is entered in the same transaction.

        Parameters
        ----------
        expected_revision : int, optional
            The revision the caller has seen (0 for none); another one in the store is a conflict.

        Raises
        ------
        InputError
            If the edge would close a loop, is longer than ``FARTHEST_FRAME_M``, or the validity is empty.
        ConflictError
            If somebody else revised the frame first.
        """
        with self._database.write() as connection:
            return self.set_in(
                connection, frame, parent, T_parent_frame, valid_from_ns=valid_from_ns, valid_until_ns=valid_until_ns,
                producer=producer, expected_revision=expected_revision,
            )  # fmt: skip

    def set_in(
        self, connection: Connection, frame: str, parent: str, T_parent_frame: UncertainTransform,
        *, valid_from_ns: int | None = None, valid_until_ns: int | None = None, producer: str = "",
        expected_revision: int | None = None,
    ) -> FrameRevision:  # fmt: skip
        """As ``set``, inside a transaction."""
        checked_frame(frame)
        checked_frame(parent, "parent")
        _check_bounds(frame, T_parent_frame)
        if valid_from_ns is not None and valid_until_ns is not None and valid_from_ns >= valid_until_ns:
            raise InputError(f"frame {frame}: validity {valid_from_ns}..{valid_until_ns} is empty")
        last = self._last_revision(connection, frame)
        if expected_revision is not None and expected_revision != last:
            raise ConflictError(f"frame {frame} is at revision {last}, not {expected_revision}; read it again")
        if frame in self._chain(connection, parent, None, EVERYTHING):
            raise InputError(f"{parent} is below {frame}: the edge would close a loop")
        now_ns = self._clock.now_ns()
        row = {
            "frame": frame, "revision": last + 1, "parent": parent, **pack(T_parent_frame),
            "valid_from_ns": valid_from_ns, "valid_until_ns": valid_until_ns,
            "inserted_ns": now_ns, "producer": producer,
        }  # fmt: skip
        connection.execute(insert(schema.frames), row)
        number = insert(schema.frame_log).returning(schema.frame_log.c.ordinal)
        state: int = connection.execute(number, {"frame": frame, "revision": last + 1}).scalar_one()
        body = {"frame": frame, "parent": parent, "revision": last + 1, "frames_revision": state}
        scope = frame.split("/", maxsplit=1)[0] if "/" in frame else "ground"
        self._events.append_in(connection, scope, "reanchored", body, now_ns)
        return FrameRevision(
            frame, last + 1, parent, T_parent_frame, valid_from_ns, valid_until_ns, now_ns, producer, state
        )

    def revisions(self, frame: str) -> tuple[FrameRevision, ...]:
        """All revisions of a frame, oldest first; raises FrameNotFoundError if there is none."""
        with self._database.read() as connection:
            rows = connection.execute(
                _SELECT.where(schema.frames.c.frame == frame).order_by(schema.frames.c.revision)
            ).all()
        if not rows:
            raise FrameNotFoundError(f"frame {frame!r} has no fixed edge in the store")
        return tuple(_revision(row) for row in rows)

    def current(self, as_of_ns: int | None = None, state: int | None = None) -> tuple[FrameRevision, ...]:
        """The last revision of every frame, as known at ``as_of_ns`` or in a state; by name."""
        with self._database.read() as connection:
            edges = self.tree_in(connection, Known(as_of_ns, state)).edges
        return tuple(edges[name] for name in sorted(edges))

    def state(self) -> int:
        """Number of the newest revision of any frame, 0 without any."""
        with self._database.read() as connection:
            return self.state_in(connection)

    @staticmethod
    def state_in(connection: Connection) -> int:
        """As ``state``, inside a transaction."""
        return sqlite.newest_frame_revision(connection)

    def state_of(self, frame: str, revision: int) -> int:
        """State of the tree right after a revision of one frame; raises FrameNotFoundError without it."""
        n = schema.frame_log.c
        with self._database.read() as connection:
            found: int | None = connection.execute(
                select(n.ordinal).where(n.frame == frame, n.revision == revision)
            ).scalar_one_or_none()
        if found is None:
            raise FrameNotFoundError(f"frame {frame!r} has no revision {revision}")
        return found

    def tree_in(self, connection: Connection, known: Known = EVERYTHING) -> FrameTree:
        """The tree of last revisions, as far as known; states asked for lately are kept ready."""
        newest = self.state_in(connection)
        if known.as_of_ns is None and known.state is not None:
            newest = min(newest, known.state)
        key = (newest, Known(known.as_of_ns, None))
        tree = self._trees.get(key)
        if tree is None:
            tree = self._trees[key] = FrameTree(newest, self._edges(connection, known))
            while len(self._trees) > _CACHED_TREES:
                self._trees.popitem(last=False)
        return tree

    @staticmethod
    def _edges(connection: Connection, known: Known) -> dict[str, FrameRevision]:
        f = schema.frames.c
        newest = select(f.frame, func.max(f.revision).label("revision")).group_by(f.frame)
        last = newest.where(*_known(known)).subquery()
        joined = and_(f.frame == last.c.frame, f.revision == last.c.revision)
        rows = connection.execute(_SELECT.join(last, joined)).all()
        return {row.frame: _revision(row) for row in rows}

    def lookup(
        self, parent: str, child: str, stamp_ns: int | None = None, known: Known = EVERYTHING
    ) -> UncertainTransform:
        """``T_parent_child`` over fixed edges; raises FrameNotFoundError where no chain of them joins the two.

        Parameters
        ----------
        stamp_ns : int, optional
            Capture time the edges must be valid at; default: newest revision whatever its validity.
        known : Known
            What of the history counts.
        """
        with self._database.read() as connection:
            return self.lookup_in(connection, parent, child, stamp_ns, known)

    def lookup_in(
        self, connection: Connection, parent: str, child: str, stamp_ns: int | None = None, known: Known = EVERYTHING
    ) -> UncertainTransform:
        """As ``lookup``, inside a transaction."""
        if parent == child:
            return IDENTITY
        graph = FrameGraph()
        for frame in (parent, child):
            for name, edge in self._chain(connection, frame, stamp_ns, known).items():
                if edge is not None:
                    graph.set_static(edge.parent, name, edge.T_parent_frame)
        return graph.lookup(parent, child, stamp_ns or 0)

    def _chain(
        self, connection: Connection, frame: str, stamp_ns: int | None, known: Known
    ) -> dict[str, FrameRevision | None]:
        """The frame and all above it with the edge that leads up; None at the top."""
        chain: dict[str, FrameRevision | None] = {}
        name = frame
        while name not in chain and len(chain) < _MAX_DEPTH:
            chain[name] = edge = self.edge_in(connection, name, stamp_ns, known)
            if edge is None:
                break
            name = edge.parent
        return chain

    def edge_in(
        self, connection: Connection, frame: str, stamp_ns: int | None, known: Known = EVERYTHING
    ) -> FrameRevision | None:
        """The revision of a frame's fixed edge that holds at a capture time, inside a transaction; None without."""
        f = schema.frames.c
        statement = _SELECT.where(f.frame == frame, *_known(known))
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


def _check_bounds(frame: str, T: UncertainTransform) -> None:
    distance_m = float(np.abs(T.matrix[:3, 3]).max())
    variance = 0.0 if T.covariance is None else float(np.abs(T.covariance).max())
    if not (distance_m <= FARTHEST_FRAME_M and variance <= FARTHEST_FRAME_M**2):
        raise InputError(
            f"frame {frame}: {distance_m:g} m from its parent, variances up to {variance:g}; expected at most "
            f"{FARTHEST_FRAME_M:g} m and its square"
        )


_NUMBER = schema.frame_log.c
_SELECT = select(schema.frames, _NUMBER.ordinal.label("state")).join(
    schema.frame_log,
    and_(_NUMBER.frame == schema.frames.c.frame, _NUMBER.revision == schema.frames.c.revision),
)


def _known(known: Known) -> list[ColumnElement[bool]]:
    f, n = schema.frames.c, schema.frame_log.alias()
    conditions: list[ColumnElement[bool]] = []
    if known.as_of_ns is not None:
        conditions.append(f.inserted_ns <= known.as_of_ns)
    if known.state is not None:
        numbered = exists().where(n.c.frame == f.frame, n.c.revision == f.revision, n.c.ordinal <= known.state)
        conditions.append(numbered)
    return conditions


def _revision(row: Row[Any]) -> FrameRevision:
    return FrameRevision(
        row.frame, row.revision, row.parent, unpack(row.matrix, row.covariance), row.valid_from_ns,
        row.valid_until_ns, row.inserted_ns, row.producer, row.state,
    )  # fmt: skip
