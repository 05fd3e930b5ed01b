# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Series of poses as lines, one per source of a moving frame."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import FrameNotFoundError, ProductNotFoundError
from dpm_store import Track
from services.dpm.http.catalogue import Collection, box_outline
from services.dpm.http.context import Context
from services.dpm.http.places import Places

TRACKS = "trajectories"
#: A line has this many corners at most; longer series are thinned evenly.
_MAX_POSES = 2000


@dataclass(frozen=True, slots=True)
class TrackRecord:
    """A series of poses with its line in the site's plane; None where it cannot be placed."""

    id: str
    robot: str
    parent: str
    child: str
    source: str
    t0_ns: int
    t1_ns: int
    count: int
    in_site: BaseGeometry | None


@dataclass(frozen=True, slots=True)
class FoundTracks:
    """A page of tracks with their lines in degrees."""

    items: tuple[tuple[TrackRecord, BaseGeometry | None], ...]
    cursor: str | None


def track_collection(context: Context) -> Collection | None:
    """The collection of all tracks; None without any."""
    tracks = context.dpm.store.poses.tracks()
    if not tracks:
        return None
    places = Places(context.dpm.store, context.anchor)
    lines = [line for t in tracks if (line := places.on_body(_line(context, t))) is not None]
    bounds = None if not lines else tuple(float(v) for v in shapely.total_bounds(lines))
    t0_ns, t1_ns = min(t.t0_ns for t in tracks), max(t.t1_ns for t in tracks)
    return Collection(TRACKS, bounds, t0_ns, t1_ns)  # type: ignore[arg-type]  # total_bounds gives four


def tracks_in(
    context: Context, bbox: Sequence[float] | None, t0_ns: int | None, t1_ns: int | None, robot: str | None,
    limit: int, cursor: str | None,
) -> FoundTracks:  # fmt: skip
    """Tracks by place and time, in the order of their ids."""
    place = None if bbox is None else box_outline(bbox)
    places = Places(context.dpm.store, context.anchor)
    kept: list[tuple[TrackRecord, BaseGeometry | None]] = []
    for track in sorted(context.dpm.store.poses.tracks(robot), key=_id):
        if cursor is not None and _id(track) <= cursor:
            continue
        if (t0_ns is not None and track.t1_ns < t0_ns) or (t1_ns is not None and track.t0_ns > t1_ns):
            continue
        line = _line(context, track)
        outline = places.on_body(line)
        if place is None or (outline is not None and outline.intersects(place)):
            kept.append((_record(track, line), outline))
            if len(kept) > limit:
                break
    return FoundTracks(tuple(kept[:limit]), kept[limit - 1][0].id if len(kept) > limit else None)


def track_of(context: Context, track_id: str) -> tuple[TrackRecord, BaseGeometry | None]:
    """A track by its id; raises ProductNotFoundError."""
    try:
        name = base64.urlsafe_b64decode(track_id + "=" * (-len(track_id) % 4)).decode()
    except (binascii.Error, ValueError) as error:
        raise ProductNotFoundError(f"no trajectory {track_id[:80]!r}") from error
    for track in context.dpm.store.poses.tracks():
        if _name(track) == name:
            line = _line(context, track)
            return _record(track, line), Places(context.dpm.store, context.anchor).on_body(line)
    raise ProductNotFoundError(f"no trajectory {track_id[:80]!r}")


def _name(track: Track) -> str:
    return f"{track.child}|{track.parent}|{track.source}"


def _id(track: Track) -> str:
    return base64.urlsafe_b64encode(_name(track).encode()).decode().rstrip("=")


def _record(track: Track, line: BaseGeometry | None) -> TrackRecord:
    return TrackRecord(
        _id(track), track.robot, track.parent, track.child, track.source, track.t0_ns, track.t1_ns, track.count, line
    )


def _line(context: Context, track: Track) -> BaseGeometry | None:
    try:
        T = context.dpm.store.frames.lookup("site", track.parent)
    except FrameNotFoundError:
        return None
    xy = T.apply(context.dpm.store.path(track, _MAX_POSES))[:, :2]
    return shapely.LineString(np.repeat(xy, 2, axis=0) if len(xy) == 1 else xy)
