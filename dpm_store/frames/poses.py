# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time series of poses, and lookups of any frame in any other over fixed and moving edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Connection, and_, func, or_, select, update

from cdff_common.errors import ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, PoseTrack, UncertainTransform
from cdff_common.geometry.frame_graph import EXTRAPOLATION_LIMIT_NS
from dpm_store.engine import schema
from dpm_store.engine.array_columns import pack, to_lists, unpack
from dpm_store.engine.database import Database, dialect_of
from dpm_store.frames.frames import IDENTITY, LATEST, FrameTable, HistoryView

#: Largest number of frames in a chain to the root: frames stored by clients may form a cycle.
_MAX_DEPTH = 64


@dataclass(frozen=True, slots=True)
class StampedPose:
    """``T_parent_child`` at a time, and its source product."""

    stamp_ns: int
    parent: str
    child: str
    pose: UncertainTransform
    source: str
    product_id: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for MessagePack and JSON."""
        return {
            "stamp_ns": self.stamp_ns,
            "parent": self.parent,
            "child": self.child,
            **to_lists(self.pose),
            "source": self.source,
            "product_id": self.product_id,
        }


@dataclass(frozen=True, slots=True)
class Track:
    """A moving edge with the interval and number of its poses."""

    parent: str
    child: str
    source: str
    robot: str
    t0_ns: int
    t1_ns: int
    count: int


class PoseTable:
    """Transforms of the frame tree that change with time, as poses with time stamps."""

    def __init__(self, database: Database, frames: FrameTable) -> None:
        self._database = database
        self._frames = frames

    @staticmethod
    def add_in(
        connection: Connection,
        robot: str,
        source: str,
        poses: list[tuple[int, UncertainTransform]],
        *,
        parent: str,
        child: str,
        product_id: str,
        inserted_ns: int,
    ) -> None:
        """Insert the poses of a product in a transaction; the first pose of a stamp and source is used."""
        edge = {"parent": parent, "child": child, "source": source, "robot": robot}
        origin = {"product_id": product_id, "inserted_ns": inserted_ns}
        rows = [{**edge, **origin, "stamp_ns": stamp_ns, **pack(T)} for stamp_ns, T in poses]
        if rows:
            dialect = dialect_of(connection)
            dialect.upsert_rows(connection, schema.tracks, [edge])
            dialect.insert_rows(connection, schema.poses, rows)

    @staticmethod
    def delete_in(connection: Connection, product_id: str, deleted_ns: int) -> None:
        """Exclude the poses of a deleted product from lookups after ``deleted_ns``."""
        p = schema.poses.c
        connection.execute(
            update(schema.poses).where(p.product_id == product_id).values(deleted_ns=deleted_ns)
        )

    def at(
        self,
        stamp_ns: int,
        parent: str,
        child: str,
        *,
        limit_ns: int = EXTRAPOLATION_LIMIT_NS,
        view: HistoryView = LATEST,
        connection: Connection | None = None,
    ) -> UncertainTransform:
        """Return ``T_parent_child`` at a time, interpolated, composed over fixed and moving edges.

        Parameters
        ----------
        limit_ns : int
            Largest distance in time from a track.
        view : HistoryView
            Part of the history to use: frames by time or state, poses by time.

        Raises
        ------
        FrameNotFoundError
            If no chain of edges connects the two.
        ExtrapolationError
            If a track on the chain does not cover the time.
        """
        with self._database.read(connection) as connection:
            if parent == child:
                return IDENTITY
            graph, extrapolation_errors = FrameGraph(), []
            for frame in (parent, child):
                name = frame
                for _ in range(_MAX_DEPTH):
                    fixed = self._frames.edge_in(connection, name, stamp_ns, view)
                    if fixed is not None:
                        graph.set_static(fixed.parent, name, fixed.T_parent_frame)
                        name = fixed.parent
                        continue
                    try:
                        moving = self._moving(connection, name, stamp_ns, limit_ns, view)
                    except ExtrapolationError as error:
                        extrapolation_errors.append(error)
                        break
                    if moving is None:
                        break
                    graph.set_static(moving.parent, name, moving.pose)
                    name = moving.parent
            try:
                return graph.lookup(parent, child, stamp_ns)
            except FrameNotFoundError:
                if extrapolation_errors:
                    raise extrapolation_errors[0] from None
                raise

    def tracks(self, robot: str | None = None) -> tuple[Track, ...]:
        """Return every moving edge with the interval of its poses."""
        p = schema.poses.c
        statement = (
            select(
                p.parent, p.child, p.source, p.robot, func.min(p.stamp_ns), func.max(p.stamp_ns), func.count()
            )
            .where(p.deleted_ns.is_(None))
            .group_by(p.child, p.parent, p.source, p.robot)
        )
        if robot is not None:
            statement = statement.where(p.robot == robot)
        with self._database.read() as connection:
            return tuple(Track(*row) for row in connection.execute(statement))

    def series(
        self,
        robot: str,
        t0_ns: int | None = None,
        t1_ns: int | None = None,
        *,
        frame: str,
        child: str | None = None,
        limit: int = 10_000,
        thin: bool = False,
        view: HistoryView = LATEST,
    ) -> tuple[StampedPose, ...]:
        """Return the poses of a robot in a frame, in time order; ``child`` defaults to ``{robot}/base``.

        Poses in a frame that no fixed edges connect with ``frame`` are left out. If there are more than
        ``limit`` and ``thin`` is set, the result has every k-th pose and the last.

        Raises
        ------
        InputError
            If there are more than ``limit`` and ``thin`` is not set.
        """
        p = schema.poses.c
        child = child or f"{robot}/base"
        statement = select(schema.poses).where(p.robot == robot, p.child == child, _in_view(view))
        if t0_ns is not None:
            statement = statement.where(p.stamp_ns >= t0_ns)
        if t1_ns is not None:
            statement = statement.where(p.stamp_ns <= t1_ns)
        order = (p.stamp_ns, p.source, p.ordinal)
        with self._database.read() as connection:
            rows = connection.execute(statement.order_by(*order).limit(limit + 1)).all()
            if thin and len(rows) > limit:
                number = func.row_number().over(order_by=order).label("number")
                count = connection.execute(
                    select(func.count()).select_from(statement.subquery())
                ).scalar_one()
                step = -(-count // limit)
                numbered = statement.add_columns(number).subquery()
                n = numbered.c.number
                sampled = select(numbered).where(((n - 1) % step == 0) | (n == count)).order_by(n)
                rows = connection.execute(sampled).all()
            tree = self._frames.tree(view, connection=connection)
        if len(rows) > limit and not thin:
            raise InputError(f"more than {limit} poses of {robot} in that span; narrow t0 and t1")
        first: dict[tuple[int, str, str], StampedPose] = {}
        for row in rows:
            T = tree.find(frame, row.parent)
            if T is not None:
                pose = _with_stamp(row)
                moved = pose if T is IDENTITY else replace(pose, parent=frame, pose=T @ pose.pose)
                first.setdefault((row.stamp_ns, row.source, row.parent), moved)
        return tuple(first.values())

    def path(self, track: Track, max_positions: int) -> NDArray[np.float64]:
        """Return positions of a track in its parent frame, ``(n, 3)``, metres: every k-th by time and the
        last.

        ``max_positions`` limits their number approximately.
        """
        p = schema.poses.c
        number = func.row_number().over(order_by=(p.stamp_ns, p.ordinal)).label("number")
        rows = _track(track.child, track.parent, track.source, LATEST).where(p.robot == track.robot)
        numbered = rows.with_only_columns(p.matrix, number).subquery().c
        step = max(-(-track.count // max_positions), 1)
        is_sampled = ((numbered.number - 1) % step == 0) | (numbered.number == track.count)
        statement = select(numbered.matrix).where(is_sampled).order_by(numbered.number)
        with self._database.read() as connection:
            matrices = connection.execute(statement).scalars().all()
        return np.frombuffer(b"".join(matrices), "<f8").reshape(-1, 4, 4)[:, :3, 3].copy()

    def newest_ns(
        self, *frames: str, view: HistoryView = LATEST, connection: Connection | None = None
    ) -> int | None:
        """Return the newest time for which every moving edge above these frames has a pose.

        None if none of them moves.
        """
        with self._database.read(connection) as connection:
            newest_stamps: list[int] = []
            for name in frames:
                for _ in range(_MAX_DEPTH):
                    fixed = self._frames.edge_in(connection, name, None, view)
                    if fixed is not None:
                        name = fixed.parent
                        continue
                    p = schema.poses.c
                    newest = [
                        _track(name, parent, source, view).order_by(p.stamp_ns.desc(), p.ordinal).limit(1)
                        for parent, source in _tracks(connection, name)
                    ]
                    rows = [row for track in newest for row in connection.execute(track)]
                    row = max(rows, key=lambda row: int(row.stamp_ns), default=None)
                    if row is None:
                        break
                    newest_stamps.append(row.stamp_ns)
                    name = row.parent
            return min(newest_stamps) if newest_stamps else None

    def _moving(
        self, connection: Connection, child: str, stamp_ns: int, limit_ns: int, view: HistoryView
    ) -> StampedPose | None:
        """Return the pose of a child from the source with the closest poses in time; None if there is no
        source.
        """
        p = schema.poses.c
        candidates: list[tuple[int, str, StampedPose]] = []
        problem: ExtrapolationError | None = None
        for parent, source in _tracks(connection, child):
            poses_of_track = _track(child, parent, source, view)
            before = connection.execute(
                poses_of_track.where(p.stamp_ns <= stamp_ns).order_by(p.stamp_ns.desc(), p.ordinal).limit(1)
            ).first()
            after = connection.execute(
                poses_of_track.where(p.stamp_ns >= stamp_ns).order_by(p.stamp_ns, p.ordinal).limit(1)
            ).first()
            track, neighbours = (
                PoseTrack(limit_ns),
                [_with_stamp(row) for row in (before, after) if row is not None],
            )
            if not neighbours:
                continue
            for pose in neighbours:
                track.insert(pose.stamp_ns, pose.pose)
            try:
                interpolated = track.at(stamp_ns, f"{parent} to {child} by {source}")
            except ExtrapolationError as error:
                problem = error
                continue
            nearest = min(neighbours, key=lambda pose: abs(pose.stamp_ns - stamp_ns))
            candidates.append(
                (
                    track.gap_ns(stamp_ns),
                    source,
                    StampedPose(stamp_ns, parent, child, interpolated, source, nearest.product_id),
                )
            )
        if not candidates and problem is not None:
            raise problem
        if not candidates:
            return None
        *_, pose = min(candidates, key=lambda candidate: candidate[:2])  # by gap, then source
        return pose


def _tracks(connection: Connection, child: str) -> list[tuple[str, str]]:
    """Return parent and source of every moving edge of a frame."""
    t = schema.tracks.c
    rows = connection.execute(select(t.parent, t.source).where(t.child == child))
    return [(row.parent, row.source) for row in rows]


def _in_view(view: HistoryView) -> ColumnElement[bool]:
    """Return the condition that a pose belongs to a view."""
    p = schema.poses.c
    if view.as_of_ns is None:
        return p.deleted_ns.is_(None)
    return and_(p.inserted_ns <= view.as_of_ns, or_(p.deleted_ns.is_(None), p.deleted_ns > view.as_of_ns))


def _track(child: str, parent: str, source: str, view: HistoryView) -> Any:
    p = schema.poses.c
    return select(schema.poses).where(
        p.child == child, p.parent == parent, p.source == source, _in_view(view)
    )


def _with_stamp(row: Any) -> StampedPose:
    pose = unpack(row.matrix, row.covariance)
    return StampedPose(row.stamp_ns, row.parent, row.child, pose, row.source, row.product_id)
