# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/tracks``: directions, ranges and positions of tracked objects over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.codecs import decode
from cdff_common.contract.parameters import Frame, Parameters, Robot, Stamp, Whole
from cdff_common.contract.queries import SearchParameters
from cdff_common.errors import CdffError
from cdff_common.geometry import UncertainTransform
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
    """State of an object; the range and the position are null while they are not observable, and the
    directions of tracks that have only poses.
    """

    stamp_ns: StampNs
    azimuth_rad: float | None
    elevation_rad: float | None
    sigma_azimuth_rad: float | None
    sigma_elevation_rad: float | None
    range_m: float | None
    sigma_range_m: float | None
    position_m: Annotated[list[float] | None, Field(description="x, y, z in position_frame")]
    position_covariance: Annotated[
        list[list[float]] | None, Field(description="Covariance of the position, 3 x 3, square metres")
    ]
    status: str
    reasons: list[str]
    product: Annotated[str, Field(description="Id of the product")]


class TrackedObject(OpenModel):
    """An object that a DFPC of a robot tracks in a frame, with its states in the order of time."""

    robot: str
    dfpc: str
    frame: str
    position_frame: str
    id: int
    label: str
    states: list[ObjectState]


class TrackParameters(Parameters):
    """Filters of the states."""

    robot: Robot | None = Field(None, description="Robot id; default: all")
    frame: Frame | None = Field(None, description="Frame of the tracks; default: all")
    position_frame: Frame | None = Field(
        None,
        description="Frame of the positions, null where no transform is known; default: that of the track",
    )
    t0: Stamp | None = Field(None, description="Start of the span: nanoseconds or RFC 3339")
    t1: Stamp | None = Field(None, description="End of the span")
    limit: Annotated[Whole, Field(ge=1, le=1000)] = Field(
        200, description="Largest number of states of all frames, the newest ones"
    )


@router.get("", response_model=Items[TrackedObject])
def tracks(context: Ctx, parameters: Annotated[TrackParameters, Query()]) -> dict[str, Any]:
    """Return the newest states of tracked objects: directions, ranges and positions where they are
    observable, with their errors.
    """
    search = parameters.model_dump(include={"robot", "t0", "t1", "limit"}, exclude_none=True)
    page = context.dpm.retrieval.search(SearchParameters.model_validate({**search, "type": ("track",)}))
    objects: dict[tuple[str, str, str, int], dict[str, Any]] = {}
    for record in reversed(page.items):
        if record.size == 0 or parameters.frame not in (None, record.header.frame):
            continue
        track = _track(context, record)
        if track is None:
            continue
        key = (record.robot, record.dfpc, record.header.frame, track.metadata.track_id)
        entry = objects.setdefault(key, {"label": "", "states": {}})
        entry["label"] = track.metadata.label
        for state in _states(record, track):
            # Consecutive products of a track repeat states; the first product states their status.
            entry["states"].setdefault(state["stamp_ns"], state)
    newest = sorted((ns for entry in objects.values() for ns in entry["states"]), reverse=True)
    first_ns = newest[: parameters.limit][-1] if newest else 0
    items = []
    for (robot, dfpc, frame, number), entry in objects.items():
        states = [entry["states"][ns] for ns in sorted(entry["states"]) if ns >= first_ns]
        position_frame = parameters.position_frame or frame
        for state in states:
            state |= _position(context, state.pop("pose"), state["stamp_ns"], frame, position_frame)
        if states:
            names = {"robot": robot, "dfpc": dfpc, "frame": frame, "position_frame": position_frame}
            items.append({**names, "id": number, "label": entry["label"], "states": states})
    return {"items": jsonable(items)}


def _track(context: Context, record: ProductRecord) -> ObjectTrack | None:
    """Return a stored track with its states; None for other types."""
    if record.type_name != "ObjectTrack":
        return None
    _, payload = context.dpm.retrieval.payload(record.id)
    track: ObjectTrack = decode(record.type_name, payload, record.codec)
    return track


def _states(record: ProductRecord, track: ObjectTrack) -> list[dict[str, Any]]:
    """Return the states of a track; earlier ones than the last were confirmed, as in its CSV."""
    states = []
    stamps_us, data = track.data.stamps, track.data
    for i, stamp_us in enumerate(stamps_us.tolist()):
        is_last = i == len(stamps_us) - 1
        status = track.metadata.status if is_last else ObjectTrackStatusT.TRACK_CONFIRMED
        bearing = data.bearings[i].tolist() if len(data.bearings) else [None] * len(_COLUMNS)
        covariance = data.covariances[i].reshape(6, 6)[:3, :3] if len(data.covariances) else None
        states.append(
            {
                "stamp_ns": stamp_us * 1000,
                **dict(zip(_COLUMNS, bearing, strict=True)),
                "pose": (data.poses[i, :3], covariance),
                "status": ObjectTrackStatusT(status).name.removeprefix("TRACK_").lower(),
                "reasons": list(record.header.quality.reasons),
                "product": record.id,
            }
        )
    return states


def _position(
    context: Context,
    pose: tuple[NDArray[np.float64], NDArray[np.float64] | None],
    stamp_ns: int,
    frame: str,
    position_frame: str,
) -> Mapping[str, list[Any] | None]:
    """Return a position and its covariance in another frame; None where they are not known."""
    unknown = {"position_m": None, "position_covariance": None}
    position_m, covariance = pose
    if not np.isfinite(position_m).all():
        return unknown
    matrix, of_pose = np.eye(4), np.zeros((6, 6))
    matrix[:3, 3] = position_m
    object_pose = UncertainTransform(matrix)
    if covariance is not None and np.isfinite(covariance).all():
        of_pose[:3, :3] = covariance
        object_pose = UncertainTransform(matrix, of_pose)
    if position_frame != frame:
        try:
            object_pose = context.dpm.store.poses.at(stamp_ns, position_frame, frame) @ object_pose
        except CdffError:
            return unknown
    known = object_pose.covariance
    return {
        "position_m": object_pose.matrix[:3, 3].tolist(),
        "position_covariance": None if known is None else known[:3, :3].tolist(),
    }
