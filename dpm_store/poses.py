# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses as time series, joined with the fixed frames: any frame in any other at any time that is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, func, select

from cdff_common.errors import ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, PoseTrack, UncertainTransform
from dpm_store import schema, sqlite
from dpm_store.arrays import pack, unpack
from dpm_store.database import Database
from dpm_store.frames import IDENTITY, FrameTable

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
        *, parent: str, child: str, product_id: str,
    ) -> None:  # fmt: skip
        """Enter the poses of a product, in its transaction; the first product for a stamp and source is kept."""
        edge = {"parent": parent, "child": child, "source": source, "robot": robot, "product_id": product_id}
        rows = [{**edge, "stamp_ns": stamp_ns, **pack(T)} for stamp_ns, T in poses]
        if rows:
            connection.execute(sqlite.insert_new(schema.poses), rows)

    def at(
        self, stamp_ns: int, parent: str, child: str, *, limit_ns: int | None = None, as_of_ns: int | None = None
    ) -> UncertainTransform:
        """``T_parent_child`` at a time, interpolated, composed over fixed and moving edges.

        Parameters
        ----------
        limit_ns : int, optional
            How far outside a track's span its nearest pose still counts, default ``EXTRAPOLATION_LIMIT_NS``.
        as_of_ns : int, optional
            Use only the fixed revisions that the store knew by then.

        Raises
        ------
        FrameNotFoundError
            If no chain of known edges joins the two.
        ExtrapolationError
            If a track on the chain does not cover the time.
        """
        with self._database.read() as connection:
            return self.at_in(connection, stamp_ns, parent, child, limit_ns=limit_ns, as_of_ns=as_of_ns)

    def at_in(
        self, connection: Connection, stamp_ns: int, parent: str, child: str,
        *, limit_ns: int | None = None, as_of_ns: int | None = None,
    ) -> UncertainTransform:  # fmt: skip
        """As ``at``, inside a transaction."""
        if parent == child:
            return IDENTITY
        limit = self._limit_ns if limit_ns is None else limit_ns
        graph, late = FrameGraph(), []
        for frame in (parent, child):
            name = frame
            for _ in range(_MAX_DEPTH):
                fixed = self._frames.edge_in(connection, name, stamp_ns, as_of_ns)
                if fixed is not None:
                    graph.set_static(fixed.parent, name, fixed.T_parent_frame)
                    name = fixed.parent
                    continue
                try:
                    moving = self._moving(connection, name, stamp_ns, limit)
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
        statement = select(
            p.parent, p.child, p.source, p.robot, func.min(p.stamp_ns), func.max(p.stamp_ns), func.count()
        ).group_by(p.child, p.parent, p.source, p.robot)
        if robot is not None:
            statement = statement.where(p.robot == robot)
        with self._database.read() as connection:
            return tuple(Track(*row) for row in connection.execute(statement))

    def trajectory(
        self, robot: str, t0_ns: int | None = None, t1_ns: int | None = None,
        *, parent: str | None = None, child: str | None = None, limit: int = 10_000,
    ) -> tuple[StampedPose, ...]:  # fmt: skip
        """Poses of a robot in time order, as they were inserted; ``child`` defaults to ``{robot}/base``.

        Raises
        ------
        InputError
            If there are more than ``limit``: ask for a shorter span.
        """
        p = schema.poses.c
        statement = select(schema.poses).where(p.robot == robot, p.child == (child or f"{robot}/base"))
        if parent is not None:
            statement = statement.where(p.parent == parent)
        if t0_ns is not None:
            statement = statement.where(p.stamp_ns >= t0_ns)
        if t1_ns is not None:
            statement = statement.where(p.stamp_ns <= t1_ns)
        with self._database.read() as connection:
            rows = connection.execute(statement.order_by(p.stamp_ns, p.source).limit(limit + 1)).all()
        if len(rows) > limit:
            raise InputError(f"more than {limit} poses of {robot} in that span; narrow t0 and t1")
        return tuple(_stamped(row) for row in rows)

    def latest(self, robot: str, parent: str, child: str) -> StampedPose | None:
        """The newest pose of one edge, or None."""
        p = schema.poses.c
        statement = select(schema.poses).where(p.robot == robot, p.parent == parent, p.child == child)
        with self._database.read() as connection:
            row = connection.execute(statement.order_by(p.stamp_ns.desc()).limit(1)).first()
        return None if row is None else _stamped(row)

    def newest_ns(self, *frames: str) -> int | None:
        """Newest time at which every moving edge above these frames is known; None where none of them moves."""
        with self._database.read() as connection:
            return self.newest_in(connection, *frames)

    def newest_in(self, connection: Connection, *frames: str) -> int | None:
        """As ``newest_ns``, inside a transaction."""
        p = schema.poses.c
        found: list[int] = []
        for name in frames:
            for _ in range(_MAX_DEPTH):
                fixed = self._frames.edge_in(connection, name, None, None)
                if fixed is not None:
                    name = fixed.parent
                    continue
                newest = select(p.stamp_ns, p.parent).where(p.child == name).order_by(p.stamp_ns.desc()).limit(1)
                row = connection.execute(newest).first()
                if row is None:
                    break
                found.append(row.stamp_ns)
                name = row.parent
        return min(found) if found else None

    def _moving(self, connection: Connection, child: str, stamp_ns: int, limit_ns: int) -> StampedPose | None:
        """The pose of a child at a time from the source whose poses lie closest around it; None without any track."""
        p = schema.poses.c
        edges = connection.execute(select(p.parent, p.source).where(p.child == child).distinct()).all()
        found: list[tuple[int, str, StampedPose]] = []
        problem: ExtrapolationError | None = None
        for parent, source in edges:
            here = select(schema.poses).where(p.child == child, p.parent == parent, p.source == source)
            before = connection.execute(here.where(p.stamp_ns <= stamp_ns).order_by(p.stamp_ns.desc()).limit(1)).first()
            after = connection.execute(here.where(p.stamp_ns >= stamp_ns).order_by(p.stamp_ns).limit(1)).first()
            track, around = PoseTrack(limit_ns), [_stamped(row) for row in (before, after) if row is not None]
            for known in around:
                track.insert(known.stamp_ns, known.pose)
            try:
                pose = track.at(stamp_ns, f"{parent} to {child} by {source}")
            except ExtrapolationError as error:
                problem = error
                continue
            gap = max(abs(known.stamp_ns - stamp_ns) for known in around)
            nearest = min(around, key=lambda known: abs(known.stamp_ns - stamp_ns))
            found.append((gap, source, StampedPose(stamp_ns, parent, child, pose, source, nearest.product_id)))
        if not found and problem is not None:
            raise problem
        return min(found, key=lambda f: f[:2])[2] if found else None


def _stamped(row: Any) -> StampedPose:
    pose = unpack(row.matrix, row.covariance)
    return StampedPose(row.stamp_ns, row.parent, row.child, pose, row.source, row.product_id)
