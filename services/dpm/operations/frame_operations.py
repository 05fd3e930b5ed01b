# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses at a time, fixed frames and their revisions, bodies and the anchors of frames on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.contract.names import GROUND
from cdff_common.geodesy import Anchor, Body
from cdff_common.geometry import checked_frame
from cdff_common.geometry.frame_graph import EXTRAPOLATION_LIMIT_NS
from dpm_store import Store
from dpm_store.engine.array_columns import to_lists
from dpm_store.frames.frames import LATEST, HistoryView
from dpm_store.history.events import check_robot
from services.dpm.operations.event_publisher import EventPublisher
from services.dpm.queries.bodies import FrameEdge, NewAnchor


class FrameOperations:
    """Operations on poses, frames and bodies."""

    def __init__(self, store: Store, events: EventPublisher) -> None:
        self._store = store
        self._events = events

    def pose(
        self,
        parent: str,
        child: str,
        t_ns: int | None,
        *,
        robot: str | None = None,
        limit_s: float | None = None,
        view: HistoryView = LATEST,
    ) -> dict[str, Any]:
        """Return ``T_parent_child`` at a time (by default the newest), in JSON form."""
        checked_frame(parent, "parent")
        checked_frame(child, "child")
        if t_ns is None:
            newest_ns = self._store.poses.newest_ns(parent, child, view=view)
            t_ns = self._store.clock.now_ns() if newest_ns is None else newest_ns
        limit_ns = EXTRAPOLATION_LIMIT_NS if limit_s is None else int(limit_s * 1e9)
        T = self._store.poses.at(t_ns, parent, child, limit_ns=limit_ns, view=view)
        return {
            "parent": parent,
            "child": child,
            "stamp_ns": t_ns,
            **to_lists(T),
            "robot": robot or "",
            "frames_revision": self._store.frames.state() if view.state is None else view.state,
            "limit_s": limit_ns / 1e9,
        }

    def current(self, view: HistoryView = LATEST) -> list[dict[str, Any]]:
        """Return the last revision of every fixed frame in a view, in JSON form."""
        return [revision.to_dict() for revision in self._store.frames.current(view.as_of_ns, view.state)]

    def set_frame(self, frame: str, edge: FrameEdge, producer: str) -> dict[str, Any]:
        """Add a revision of a fixed frame; subscribers get a ``reanchored`` event."""
        check_robot(frame.split("/")[0])
        revision = self._store.frames.set(
            frame, edge.parent, edge.transform(), producer=producer, **edge.options()
        )
        self._events.publish()
        return revision.to_dict()

    def anchor(self, frame: str, new: NewAnchor, producer: str) -> dict[str, Any]:
        """Anchor a frame on a body; subscribers get a ``reanchored`` event."""
        checked_frame(frame)
        check_robot(frame.split("/")[0])
        body = self._store.anchors.body(new.body)
        revision = self._store.anchors.anchor(
            frame,
            Anchor(body, new.lon_deg, new.lat_deg, new.height_m, new.azimuth_deg),
            sigma_m=new.sigma_m,
            sigma_deg=new.sigma_deg,
            producer=producer,
            expected_revision=new.expected_revision,
        )
        self._events.publish()
        return revision.to_dict()

    def define_body(self, body: Mapping[str, Any], producer: str) -> dict[str, Any]:
        """Define a body that no authority lists, or a new revision of one; see ``Body.from_dict``."""
        check_robot(GROUND)
        new = Body.from_dict(body)
        revision = self._store.anchors.define(new, producer)
        self._events.publish()
        return new.to_dict() | {"revision": revision}
