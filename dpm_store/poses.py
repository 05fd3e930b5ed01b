# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses as time series, joined with the fixed frames: any frame in any other at any time that is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import ColumnElement, Connection, and_, func, insert, or_, select, update

from cdff_common.errors import ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, PoseTrack, UncertainTransform
from dpm_store import schema, sqlite
from dpm_store.arrays import pack, unpack
from dpm_store.database import Database
from dpm_store.frames import EVERYTHING, IDENTITY, FrameTable, Known

#: How far outside the known span the nearest pose still stands for the one asked.
EXTRAPOLATION_LIMIT_NS = 200_000_000
_MAX_DEPTH = 64


@dataclass(frozen=True, slots=True)
class StampedPose:
    """``T_parent_child`` at a time, and which product said so."""

    stamp_ns: int
    parent: str
    child: str
    pose: UncertainTransform
    source: str
    product_id: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data for MessagePack and JSON."""
        c = self.pose.covariance
        return {
            "stamp_ns": self.stamp_ns, "parent": self.parent, "child": self.child, "T": self.pose.matrix.tolist(),
            "covariance": None if c is None else c.tolist(), "source": self.source, "product_id": self.product_id,
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Track:
    """A moving edge that the store has poses of."""

    parent: str
    child: str
    source: str
    robot: str
    t0_ns: int
    t1_ns: int
    count: int


class PoseTable:
    """Moving edges of the frame tree."""

    def __init__(self, database: Database, frames: FrameTable, limit_ns: int = EXTRAPOLATION_LIMIT_NS) -> None:
        self._database = database
        self._frames = frames
        self._limit_ns = limit_ns

    @staticmethod
    def add_in(
        connection: Connection, robot: str, source: str, poses: list[tuple[int, UncertainTransform]],
        *, parent: str, child: str, product_id: str, inserted_ns: int,
    ) -> None:  # fmt: skip
        """Enter the poses of a product, in its transaction; of several for a stamp and source the first holds."""
        edge = {"parent": parent, "child": child, "source": source, "robot": robot}
        said = {"product_id": product_id, "inserted_ns": inserted_ns}
        rows = [{**edge, **said, "stamp_ns": stamp_ns, **pack(T)} for stamp_ns, T in poses]
        if rows:
            connection.execute(sqlite.insert_new(schema.tracks), edge)
            connection.execute(insert(schema.poses), rows)

    @staticmethod
    def delete_in(connection: Connection, product_id: str, deleted_ns: int) -> None:
        """Let the poses of a deleted product count no more, but for questions of what was known before."""
        p = schema.poses.c
        connection.execute(update(schema.poses).where(p.product_id == product_id).values(deleted_ns=deleted_ns))

    def at(
        self, stamp_ns: int, parent: str, child: str, *, limit_ns: int | None = None, known: Known = EVERYTHING
    ) -> UncertainTransform:
        """``T_parent_child`` at a time, interpolated, composed over fixed and moving edges.

        Parameters
        ----------
        limit_ns : int, optional
            How far outside a track's span its nearest pose still counts, default ``EXTRAPOLATION_LIMIT_NS``.
        known : Known
            What of the history counts: frames by time or state, poses by time.

        Raises
        ------
        FrameNotFoundError
            If no chain of known edges joins the two.
        ExtrapolationError
            If a track on the chain does not cover the time.
        """
        with self._database.read() as connection:
            return self.at_in(connection, stamp_ns, parent, child, limit_ns=limit_ns, known=known)

    def at_in(
        self, connection: Connection, stamp_ns: int, parent: str, child: str,
        *, limit_ns: int | None = None, known: Known = EVERYTHING,
    ) -> UncertainTransform:  # fmt: skip
        """As ``at``, inside a transaction."""
        if parent == child:
            return IDENTITY
        limit = self._limit_ns if limit_ns is None else limit_ns
        graph, late = FrameGraph(), []
        for frame in (parent, child):
            name = frame
            for _ in range(_MAX_DEPTH):
                fixed = self._frames.edge_in(connection, name, stamp_ns, known)
                if fixed is not None:
                    graph.set_static(fixed.parent, name, fixed.T_parent_frame)
                    name = fixed.parent
                    continue
                try:
                    moving = self._moving(connection, name, stamp_ns, limit, known)
                except ExtrapolationError as error:
                    late.append(error)
                    break
                if moving is None:
                    break
                graph.set_static(moving.parent, name, moving.pose)
                name = moving.parent
        try:
            return graph.lookup(parent, child, stamp_ns)
        except FrameNotFoundError:
            if late:
                raise late[0] from None
            raise

    def tracks(self, robot: str | None = None) -> tuple[Track, ...]:
        """Every moving edge with the span that is known."""
        p = schema.poses.c
        statement = (
            select(p.parent, p.child, p.source, p.robot, func.min(p.stamp_ns), func.max(p.stamp_ns), func.count())
            .where(p.deleted_ns.is_(None)).group_by(p.child, p.parent, p.source, p.robot)
        )  # fmt: skip
        if robot is not None:
            statement = statement.where(p.robot == robot)
        with self._database.read() as connection:
            return tuple(Track(*row) for row in connection.execute(statement))

    def trajectory(
        self, robot: str, t0_ns: int | None = None, t1_ns: int | None = None,
        *, parent: str | None = None, child: str | None = None, limit: int = 10_000, known: Known = EVERYTHING,
    ) -> tuple[StampedPose, ...]:  # fmt: skip
        """Poses of a robot in time order, as they were inserted; ``child`` defaults to ``{robot}/base``.

        Raises
        ------
        InputError
            If there are more than ``limit``: ask for a shorter span.
        """
        p = schema.poses.c
        child = child or f"{robot}/base"
        statement = select(schema.poses).where(p.robot == robot, p.child == child, _holds(known))
        if parent is not None:
            statement = statement.where(p.parent == parent)
        if t0_ns is not None:
            statement = statement.where(p.stamp_ns >= t0_ns)
        if t1_ns is not None:
            statement = statement.where(p.stamp_ns <= t1_ns)
        with self._database.read() as connection:
            rows = connection.execute(statement.order_by(p.stamp_ns, p.source, p.ordinal).limit(limit + 1)).all()
        if len(rows) > limit:
            raise InputError(f"more than {limit} poses of {robot} in that span; narrow t0 and t1")
        first: dict[tuple[int, str, str], StampedPose] = {}
        for row in rows:
            first.setdefault((row.stamp_ns, row.source, row.parent), _stamped(row))
        return tuple(first.values())

    def series(
        self, robot: str, t0_ns: int | None = None, t1_ns: int | None = None, *, frame: str, child: str | None = None,
        limit: int = 10_000, known: Known = EVERYTHING,
    ) -> tuple[StampedPose, ...]:  # fmt: skip
        """As ``trajectory``, seen in a frame: poses in other frames that fixed edges join with it are carried over.

        Poses in a frame that none joins with it are left out.
        """
        found = self.trajectory(robot, t0_ns, t1_ns, child=child, limit=limit, known=known)
        with self._database.read() as connection:
            tree = self._frames.tree_in(connection, known)
        seen = []
        for pose in found:
            T = tree.find(frame, pose.parent)
            if pose.parent == frame:
                seen.append(pose)
            elif T is not None:
                seen.append(replace(pose, parent=frame, pose=T @ pose.pose))
        return tuple(seen)

    def latest(self, robot: str, parent: str, child: str) -> StampedPose | None:
        """The newest pose of one edge, or None."""
        t = schema.tracks.c
        edge = select(t.parent, t.source).where(t.child == child, t.parent == parent, t.robot == robot)
        with self._database.read() as connection:
            rows = [_newest(connection, child, *track) for track in connection.execute(edge).all()]
        found = max((row for row in rows if row is not None), key=lambda row: int(row.stamp_ns), default=None)
        return None if found is None else _stamped(found)

    def newest_ns(self, *frames: str, known: Known = EVERYTHING) -> int | None:
        """Newest time at which every moving edge above these frames is known; None where none of them moves."""
        with self._database.read() as connection:
            return self.newest_in(connection, *frames, known=known)

    def newest_in(self, connection: Connection, *frames: str, known: Known = EVERYTHING) -> int | None:
        """As ``newest_ns``, inside a transaction."""
        found: list[int] = []
        for name in frames:
            for _ in range(_MAX_DEPTH):
                fixed = self._frames.edge_in(connection, name, None, known)
                if fixed is not None:
                    name = fixed.parent
                    continue
                rows = [_newest(connection, name, *track, known) for track in _tracks(connection, name)]
                row = max((row for row in rows if row is not None), key=lambda row: int(row.stamp_ns), default=None)
                if row is None:
                    break
                found.append(row.stamp_ns)
                name = row.parent
        return min(found) if found else None

    def _moving(
        self, connection: Connection, child: str, stamp_ns: int, limit_ns: int, known: Known
    ) -> StampedPose | None:
        """The pose of a child at a time from the source whose poses lie closest around it; None without any track."""
        p = schema.poses.c
        found: list[tuple[int, str, StampedPose]] = []
        problem: ExtrapolationError | None = None
        for parent, source in _tracks(connection, child):
            here = _track(child, parent, source, known)
            before = connection.execute(
                here.where(p.stamp_ns <= stamp_ns).order_by(p.stamp_ns.desc(), p.ordinal).limit(1)
            ).first()
            after = connection.execute(
                here.where(p.stamp_ns >= stamp_ns).order_by(p.stamp_ns, p.ordinal).limit(1)
            ).first()
            track, around = PoseTrack(limit_ns), [_stamped(row) for row in (before, after) if row is not None]
            if not around:
                continue
            for pose in around:
                track.insert(pose.stamp_ns, pose.pose)
            try:
                between = track.at(stamp_ns, f"{parent} to {child} by {source}")
            except ExtrapolationError as error:
                problem = error
                continue
            gap = max(abs(pose.stamp_ns - stamp_ns) for pose in around)
            nearest = min(around, key=lambda pose: abs(pose.stamp_ns - stamp_ns))
            found.append((gap, source, StampedPose(stamp_ns, parent, child, between, source, nearest.product_id)))
        if not found and problem is not None:
            raise problem
        return min(found, key=lambda f: f[:2])[2] if found else None


def _tracks(connection: Connection, child: str) -> list[tuple[str, str]]:
    """Parent and source of every moving edge of a frame."""
    t = schema.tracks.c
    rows = connection.execute(select(t.parent, t.source).where(t.child == child))
    return [(row.parent, row.source) for row in rows]


def _holds(known: Known) -> ColumnElement[bool]:
    """Condition that a pose counts."""
    p = schema.poses.c
    if known.as_of_ns is None:
        return p.deleted_ns.is_(None)
    return and_(p.inserted_ns <= known.as_of_ns, or_(p.deleted_ns.is_(None), p.deleted_ns > known.as_of_ns))


def _track(child: str, parent: str, source: str, known: Known) -> Any:
    p = schema.poses.c
    return select(schema.poses).where(p.child == child, p.parent == parent, p.source == source, _holds(known))


def _newest(connection: Connection, child: str, parent: str, source: str, known: Known = EVERYTHING) -> Any:
    p = schema.poses.c
    return connection.execute(
        _track(child, parent, source, known).order_by(p.stamp_ns.desc(), p.ordinal).limit(1)
    ).first()


def _stamped(row: Any) -> StampedPose:
    pose = unpack(row.matrix, row.covariance)
    return StampedPose(row.stamp_ns, row.parent, row.child, pose, row.source, row.product_id)
