# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/tracks``: directions and ranges of tracked objects over time."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query
from pydantic import Field

from cdff_common.codecs import decode
from cdff_common.contract.parameters import Frame, Parameters, Robot, Stamp, Whole
from cdff_common.contract.queries import SearchParameters
from cdff_common.types import ObjectTrack, ObjectTrackStatusT
from dpm_store import ProductRecord
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.models import OpenModel, StampNs
from services.dpm.http.native_models import Items

router = APIRouter(prefix="/api/v1/tracks", tags=["products"])

#: Columns of a bearing, as in ObjectTrack.
_COLUMNS = (
    "azimuth_rad",
    "elevation_rad",
    "sigma_azimuth_rad",
    "sigma_elevation_rad",
    "range_m",
    "sigma_range_m",
)


class ObjectState(OpenModel):
    """State of an object at an image; the range is null while it is not observable."""

    stamp_ns: StampNs
    azimuth_rad: float
    elevation_rad: float
    sigma_azimuth_rad: float
    sigma_elevation_rad: float
    range_m: float | None
    sigma_range_m: float | None
    status: str
    reasons: list[str]
    product: Annotated[str, Field(description="Id of the product")]


class TrackedObject(OpenModel):
    """An object of a robot in a frame, with its states in the order of time."""

    robot: str
    frame: str
    id: int
    label: str
    states: list[ObjectState]


class TrackParameters(Parameters):
    """Filters of the states."""

    robot: Robot | None = Field(None, description="Robot id; default: all")
    frame: Frame | None = Field(None, description="Frame of the directions; default: all")
    t0: Stamp | None = Field(None, description="Start of the span: nanoseconds or RFC 3339")
    t1: Stamp | None = Field(None, description="End of the span")
    limit: Annotated[Whole, Field(ge=1, le=1000)] = Field(
        200, description="Largest number of states of all frames, the newest ones"
    )


@router.get("", response_model=Items[TrackedObject])
def tracks(context: Ctx, parameters: Annotated[TrackParameters, Query()]) -> dict[str, Any]:
    """Return the newest states of tracked objects: directions, and ranges where they are observable."""
    search = parameters.model_dump(include={"robot", "t0", "t1", "limit"}, exclude_none=True)
    page = context.dpm.retrieval.search(SearchParameters.model_validate({**search, "type": ("track",)}))
    objects: dict[tuple[str, str, int], dict[str, Any]] = {}
    for record in reversed(page.items):
        if record.size == 0 or parameters.frame not in (None, record.header.frame):
            continue
        track = _track(context, record)
        if track is None:
            continue
        key = (record.robot, record.header.frame, track.metadata.track_id)
        entry = objects.setdefault(
            key, {"robot": key[0], "frame": key[1], "id": key[2], "label": "", "states": []}
        )
        entry["label"] = track.metadata.label
        entry["states"] += _states(record, track)
    return {"items": jsonable(list(objects.values()))}


def _track(context: Context, record: ProductRecord) -> ObjectTrack | None:
    """Return a stored track that has directions, else None."""
    if record.type_name != "ObjectTrack":
        return None
    _, payload = context.dpm.retrieval.payload(record.id)
    track: ObjectTrack = decode(record.type_name, payload, record.codec)
    return track if len(track.data.bearings) else None


def _states(record: ProductRecord, track: ObjectTrack) -> list[dict[str, Any]]:
    """Return the states of a track; earlier ones than the last were confirmed, as in its CSV."""
    states = []
    for i, bearing in enumerate(np.asarray(track.data.bearings, float).tolist()):
        is_last = i == len(track.data.bearings) - 1
        status = track.metadata.status if is_last else ObjectTrackStatusT.TRACK_CONFIRMED
        states.append(
            {
                "stamp_ns": int(track.data.stamps[i]) * 1000,
                **dict(zip(_COLUMNS, bearing, strict=True)),
                "status": ObjectTrackStatusT(status).name.removeprefix("TRACK_").lower(),
                "reasons": list(record.header.quality.reasons),
                "product": record.id,
            }
        )
    return states
