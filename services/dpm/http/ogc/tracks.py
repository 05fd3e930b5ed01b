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
from services.dpm.http.context import Context
from services.dpm.http.geographic_outlines import ProductOutlines
from services.dpm.http.search_places import box_outline
from services.dpm.http.stac.catalogue import Collection, bounds_deg

TRACKS = "trajectories"
#: Largest number of corners of a line; longer series are subsampled evenly.
_MAX_POSES = 2000


@dataclass(frozen=True, slots=True)
class TrackRecord:
    """A series of poses with its line, in metres of its parent frame and in degrees of the body."""

    id: str
    track: Track
    in_frame: BaseGeometry
    in_degrees: BaseGeometry | None


def track_collection(context: Context) -> Collection | None:
    """Return the collection of all tracks; None if there are none."""
    tracks = context.dpm.store.poses.tracks()
    if not tracks:
        return None
    outlines = context.places
    bounds = bounds_deg(_record(context, outlines, track).in_degrees for track in tracks)
    return Collection(TRACKS, bounds, min(t.t0_ns for t in tracks), max(t.t1_ns for t in tracks))


def tracks_in(
    context: Context,
    bbox: Sequence[float] | None,
    t0_ns: int | None,
    t1_ns: int | None,
    robot: str | None,
    limit: int,
    cursor: str | None,
) -> tuple[list[TrackRecord], str | None]:
    """Return a page of tracks by region and time, in the order of their ids, and the cursor of the next."""
    region = None if bbox is None else box_outline(bbox)
    outlines = context.places
    records: list[TrackRecord] = []
    for track in sorted(context.dpm.store.poses.tracks(robot), key=_id):
        if cursor is not None and _id(track) <= cursor:
            continue
        if (t0_ns is not None and track.t1_ns < t0_ns) or (t1_ns is not None and track.t0_ns > t1_ns):
            continue
        record = _record(context, outlines, track)
        if region is None or (record.in_degrees is not None and record.in_degrees.intersects(region)):
            records.append(record)
            if len(records) > limit:
                break
    return records[:limit], records[limit - 1].id if len(records) > limit else None


def track_of(context: Context, track_id: str) -> TrackRecord:
    """Return a track by its id; raises ProductNotFoundError."""
    for track in context.dpm.store.poses.tracks():
        if _id(track) == track_id:
            return _record(context, context.places, track)
    raise ProductNotFoundError(f"no trajectory {track_id[:80]!r}")


def _id(track: Track) -> str:
    name = f"{track.child}|{track.parent}|{track.source}|{track.robot}"
    return base64.urlsafe_b64encode(name.encode()).decode().rstrip("=")


def _record(context: Context, outlines: ProductOutlines, track: Track) -> TrackRecord:
    xy = context.dpm.store.poses.path(track, _MAX_POSES)[:, :2]
    line = shapely.LineString(np.repeat(xy, 2, axis=0) if len(xy) == 1 else xy)
    is_on_body = outlines.body_of(track.parent) == outlines.body
    in_degrees = outlines.outline_in_degrees(track.parent, line) if is_on_body else None
    return TrackRecord(_id(track), track, line, in_degrees)
