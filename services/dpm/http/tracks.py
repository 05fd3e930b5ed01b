# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Series of poses as lines, one per source of a moving frame."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import ProductNotFoundError
from dpm_store import Track
from services.dpm.http.catalogue import Collection, box_outline
from services.dpm.http.context import Context
from services.dpm.http.places import Places

TRACKS = "trajectories"
#: A line has this many corners at most; longer series are thinned evenly.
_MAX_POSES = 2000


@dataclass(frozen=True, slots=True)
class TrackRecord:
    """A series of poses with its line, in metres of its parent frame and in degrees of the body."""

    id: str
    robot: str
    parent: str
    child: str
    source: str
    t0_ns: int
    t1_ns: int
    count: int
    in_frame: BaseGeometry
    on_body: BaseGeometry | None


@dataclass(frozen=True, slots=True)
class FoundTracks:
    """A page of tracks, and where to go on."""

    items: tuple[TrackRecord, ...]
    cursor: str | None


def track_collection(context: Context) -> Collection | None:
    """The collection of all tracks; None without any."""
    tracks = context.dpm.store.poses.tracks()
    if not tracks:
        return None
    places = Places(context.dpm.store)
    lines = [line for t in tracks if (line := _record(context, places, t).on_body) is not None]
    bounds = None if not lines else tuple(float(v) for v in shapely.total_bounds(lines))
    t0_ns, t1_ns = min(t.t0_ns for t in tracks), max(t.t1_ns for t in tracks)
    return Collection(TRACKS, bounds, t0_ns, t1_ns)  # type: ignore[arg-type]  # total_bounds gives four


def tracks_in(
    context: Context, bbox: Sequence[float] | None, t0_ns: int | None, t1_ns: int | None, robot: str | None,
    limit: int, cursor: str | None,
) -> FoundTracks:  # fmt: skip
    """Tracks by place and time, in the order of their ids."""
    place = None if bbox is None else box_outline(bbox)
    places = Places(context.dpm.store)
    kept: list[TrackRecord] = []
    for track in sorted(context.dpm.store.poses.tracks(robot), key=_id):
        if cursor is not None and _id(track) <= cursor:
            continue
        if (t0_ns is not None and track.t1_ns < t0_ns) or (t1_ns is not None and track.t0_ns > t1_ns):
            continue
        record = _record(context, places, track)
        if place is None or (record.on_body is not None and record.on_body.intersects(place)):
            kept.append(record)
            if len(kept) > limit:
                break
    return FoundTracks(tuple(kept[:limit]), kept[limit - 1].id if len(kept) > limit else None)


def track_of(context: Context, track_id: str) -> TrackRecord:
    """A track by its id; raises ProductNotFoundError."""
    for track in context.dpm.store.poses.tracks():
        if _id(track) == track_id:
            return _record(context, Places(context.dpm.store), track)
    raise ProductNotFoundError(f"no trajectory {track_id[:80]!r}")


def _id(track: Track) -> str:
    name = f"{track.child}|{track.parent}|{track.source}|{track.robot}"
    return base64.urlsafe_b64encode(name.encode()).decode().rstrip("=")


def _record(context: Context, places: Places, track: Track) -> TrackRecord:
    xy = context.dpm.store.path(track, _MAX_POSES)[:, :2]
    line = shapely.LineString(np.repeat(xy, 2, axis=0) if len(xy) == 1 else xy)
    return TrackRecord(
        _id(track), track.robot, track.parent, track.child, track.source, track.t0_ns, track.t1_ns, track.count,
        line, places.on_body(track.parent, line),
    )  # fmt: skip
