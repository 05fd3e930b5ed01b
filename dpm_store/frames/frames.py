# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The revisioned tree of fixed frames: corrections are appended, earlier states can be queried.

Every revision also has a number in the order of all revisions, the state of the tree. It identifies the whole
tree after that revision, independently of the clock.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from sqlalchemy import ColumnElement, Connection, and_, exists, func, insert, or_, select

from cdff_common.clock import Clock
from cdff_common.errors import ConflictError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, UncertainTransform, checked_frame
from dpm_store.engine import schema
from dpm_store.engine.array_columns import pack, to_lists, unpack
from dpm_store.engine.database import Database, dialect_of
from dpm_store.history.events import EventTable

#: Largest number of ancestors of a frame.
_MAX_DEPTH = 64
#: Largest distance from the parent and largest standard deviation: several astronomical units.
FARTHEST_FRAME_M = 1e12
#: States of the tree in memory; nearly all searches use the newest.
_CACHED_TREES = 8
#: One shared object, since every search by region looks up the transform of a frame to itself.
IDENTITY = UncertainTransform.identity()


@dataclass(frozen=True, slots=True)
class HistoryView:
    """Part of the history that a lookup uses; all of it by default.

    Attributes
    ----------
    as_of_ns : int or None
        Only entries inserted up to this mission time.
    state : int or None
        Only frame revisions up to this number.
    """

    as_of_ns: int | None = None
    state: int | None = None


#: The whole history.
LATEST = HistoryView()


@dataclass(frozen=True, slots=True)
class FrameRevision:
    """One revision of the edge from ``parent`` to ``frame``.

    Attributes
    ----------
    T_parent_frame : UncertainTransform
    valid_from_ns, valid_until_ns : int or None
        Interval of capture times for which it is valid; None for an open end.
    inserted_ns : int
        Mission time of the insertion.
    state : int
        Number among all revisions of all frames.
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
        """Return plain data for MessagePack and JSON."""
        return {
            "frame": self.frame,
            "revision": self.revision,
            "parent": self.parent,
            **to_lists(self.T_parent_frame),
            "valid_from_ns": self.valid_from_ns,
            "valid_until_ns": self.valid_until_ns,
            "inserted_ns": self.inserted_ns,
            "producer": self.producer,
            "frames_revision": self.state,
        }


@dataclass(slots=True)
class FrameTree:
    """One state of the tree: the last revision of every frame, regardless of its validity.

    Attributes
    ----------
    state : int
        Number of its newest revision, 0 if it has none.
    """

    state: int
    edges: dict[str, FrameRevision]
    _graph: FrameGraph = field(default_factory=FrameGraph)
    _transforms: dict[tuple[str, str], UncertainTransform | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for edge in self.edges.values():
            self._graph.set_static(edge.parent, edge.frame, edge.T_parent_frame)

    def find(self, parent: str, child: str) -> UncertainTransform | None:
        """Return ``T_parent_child`` over fixed edges; None if they are not connected."""
        if parent == child:
            return IDENTITY
        key = (parent, child)
        if key not in self._transforms:
            try:
                self._transforms[key] = self._graph.lookup(parent, child, 0)
            except FrameNotFoundError:
                self._transforms[key] = None
        return self._transforms[key]

    def chain(self, frame: str) -> list[str]:
        """Return a frame, its parent and so on, up to the root."""
        names = [frame]
        while (edge := self.edges.get(names[-1])) is not None and len(names) <= len(self.edges):
            names.append(edge.parent)
        return names


class FrameTable:
    """Fixed edges of the frame tree."""

    def __init__(self, database: Database, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._events = events
        self._clock = clock
        self._trees: OrderedDict[tuple[int, HistoryView], FrameTree] = OrderedDict()

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
        connection: Connection | None = None,
    ) -> FrameRevision:
        """Add a revision, which moves every product of ``frame`` and of its descendants.

        The event ``reanchored`` is appended in the same transaction.

        Parameters
        ----------
        expected_revision : int, optional
            Last revision that the caller has read (0 for none); a different one in the store is a conflict.

        Raises
        ------
        InputError
            If the edge would close a loop, is longer than ``FARTHEST_FRAME_M``, or the validity is empty.
        ConflictError
            If the last revision is not ``expected_revision``.
        """
        with self._database.write(connection) as connection:
            checked_frame(frame)
            checked_frame(parent, "parent")
            _check_bounds(frame, T_parent_frame)
            if valid_from_ns is not None and valid_until_ns is not None and valid_from_ns >= valid_until_ns:
                raise InputError(f"frame {frame}: validity {valid_from_ns}..{valid_until_ns} is empty")
            edge = self.edge_in(connection, frame, None)
            last = 0 if edge is None else edge.revision
            if expected_revision is not None and expected_revision != last:
                raise ConflictError(
                    f"frame {frame} is at revision {last}, not {expected_revision}; read it again"
                )
            ancestor = parent
            for _ in range(_MAX_DEPTH):
                if ancestor == frame:
                    raise InputError(f"{parent} is below {frame}: the edge would close a loop")
                if (edge := self.edge_in(connection, ancestor, None)) is None:
                    break
                ancestor = edge.parent
            else:
                raise InputError(f"{parent} has {_MAX_DEPTH} ancestors or more, expected fewer")
            now_ns = self._clock.now_ns()
            row = {
                "frame": frame,
                "revision": last + 1,
                "parent": parent,
                **pack(T_parent_frame),
                "valid_from_ns": valid_from_ns,
                "valid_until_ns": valid_until_ns,
                "inserted_ns": now_ns,
                "producer": producer,
            }
            connection.execute(insert(schema.frames), row)
            append_to_log = insert(schema.frame_log).returning(schema.frame_log.c.ordinal)
            state: int = connection.execute(
                append_to_log, {"frame": frame, "revision": last + 1}
            ).scalar_one()
            body = {"frame": frame, "parent": parent, "revision": last + 1, "frames_revision": state}
            scope = frame.split("/", maxsplit=1)[0] if "/" in frame else "ground"
            self._events.append(scope, "reanchored", body, now_ns, connection=connection)
            return _revision(connection.execute(_SELECT.where(_LOG_COLUMNS.ordinal == state)).one())

    def revisions(self, frame: str) -> tuple[FrameRevision, ...]:
        """Return all revisions of a frame, oldest first; raises FrameNotFoundError if there is none."""
        with self._database.read() as connection:
            rows = connection.execute(
                _SELECT.where(schema.frames.c.frame == frame).order_by(schema.frames.c.revision)
            ).all()
        if not rows:
            raise FrameNotFoundError(f"frame {frame!r} has no fixed edge in the store")
        return tuple(_revision(row) for row in rows)

    def current(self, as_of_ns: int | None = None, state: int | None = None) -> tuple[FrameRevision, ...]:
        """Return the last revision of every frame at ``as_of_ns`` or in a state, by name."""
        edges = self.tree(HistoryView(as_of_ns, state)).edges
        return tuple(edges[name] for name in sorted(edges))

    def state(self, *, connection: Connection | None = None) -> int:
        """Return the number of the newest revision of any frame, 0 if there is none."""
        with self._database.read(connection) as connection:
            ((newest,),) = dialect_of(connection).fetch(connection, NEWEST)
            return newest or 0

    def tree(self, view: HistoryView = LATEST, *, connection: Connection | None = None) -> FrameTree:
        """Return the tree of a view; recently used states are cached.

        Raises
        ------
        InputError
            If the view is of a state that does not exist yet.
        """
        with self._database.read(connection) as connection:
            newest = self.state(connection=connection)
            if view.state is not None:
                if view.state > newest:
                    raise InputError(f"frames_revision={view.state}: expected at most {newest}, the newest")
                newest = view.state
            key = (newest, HistoryView(view.as_of_ns, None))
            tree = self._trees.get(key)
            if tree is None:
                tree = self._trees[key] = FrameTree(newest, self._edges(connection, view))
                while len(self._trees) > _CACHED_TREES:
                    self._trees.popitem(last=False)
            return tree

    @staticmethod
    def _edges(connection: Connection, view: HistoryView) -> dict[str, FrameRevision]:
        """Return the newest revision of each frame that a view of the history contains."""
        f = schema.frames.c
        newest = select(f.frame, func.max(f.revision).label("revision")).group_by(f.frame)
        last = newest.where(*_view_conditions(view)).subquery()
        is_last_revision = and_(f.frame == last.c.frame, f.revision == last.c.revision)
        rows = connection.execute(_SELECT.join(last, is_last_revision)).all()
        return {row.frame: _revision(row) for row in rows}

    def edge_in(
        self, connection: Connection, frame: str, stamp_ns: int | None, view: HistoryView = LATEST
    ) -> FrameRevision | None:
        """Return the revision of a frame's edge that is valid at a capture time, inside a transaction."""
        f = schema.frames.c
        statement = _SELECT.where(f.frame == frame, *_view_conditions(view))
        if stamp_ns is not None:
            statement = statement.where(
                or_(f.valid_from_ns.is_(None), f.valid_from_ns <= stamp_ns),
                or_(f.valid_until_ns.is_(None), f.valid_until_ns > stamp_ns),
            )
        row = connection.execute(statement.order_by(f.revision.desc()).limit(1)).first()
        return None if row is None else _revision(row)


def _check_bounds(frame: str, T: UncertainTransform) -> None:
    distance_m = float(np.abs(T.matrix[:3, 3]).max())
    variance = 0.0 if T.covariance is None else float(np.abs(T.covariance).max())
    if not (distance_m <= FARTHEST_FRAME_M and variance <= FARTHEST_FRAME_M**2):
        raise InputError(
            f"frame {frame}: {distance_m:g} m from its parent, variances up to {variance:g}; expected at "
            f"most {FARTHEST_FRAME_M:g} m and its square"
        )


#: State of the frame tree.
NEWEST = select(func.max(schema.frame_log.c.ordinal))
_LOG_COLUMNS = schema.frame_log.c
_SELECT = select(schema.frames, _LOG_COLUMNS.ordinal.label("state")).join(
    schema.frame_log,
    and_(_LOG_COLUMNS.frame == schema.frames.c.frame, _LOG_COLUMNS.revision == schema.frames.c.revision),
)


def _view_conditions(view: HistoryView) -> list[ColumnElement[bool]]:
    """Return the conditions that select the revisions of frames visible in a view of the history."""
    f, n = schema.frames.c, schema.frame_log.alias()
    conditions: list[ColumnElement[bool]] = []
    if view.as_of_ns is not None:
        conditions.append(f.inserted_ns <= view.as_of_ns)
    if view.state is not None:
        numbered = exists().where(n.c.frame == f.frame, n.c.revision == f.revision, n.c.ordinal <= view.state)
        conditions.append(numbered)
    return conditions


def _revision(row: Sequence[Any]) -> FrameRevision:
    frame, revision, parent, matrix, covariance, *rest = row
    return FrameRevision(frame, revision, parent, unpack(matrix, covariance), *rest)
