# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/frames`` and ``/api/v1/poses``: fixed edges with their revisions, moving edges as time series."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import Field

from cdff_common.contract.parameters import Flag, Frame, Number, Stamp, Whole
from cdff_common.contract.queries import HistoryViewParameters
from cdff_common.errors import InputError
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.native_models import FrameRevision, Frames, Items, Pose
from services.dpm.queries.bodies import FrameEdge
from services.dpm.queries.store_queries import history_view

router = APIRouter(prefix="/api/v1", tags=["frames"])


class Revision(FrameEdge):
    """A new revision of a frame's fixed edge."""

    producer: Annotated[str, Field(max_length=200)] = "http"


@router.get("/frames", response_model=Frames)
def frames(context: Ctx, parameters: Annotated[HistoryViewParameters, Query()]) -> dict[str, Any]:
    """Return the last revision of every fixed frame (at ``as_of``, or in the state ``frames_revision``), and
    the time spans of moving frames.
    """
    tracks = [asdict(track) for track in context.dpm.store.poses.tracks()]
    state = (
        context.dpm.store.frames.state() if parameters.frames_revision is None else parameters.frames_revision
    )
    return {
        "items": jsonable(context.dpm.frames.current(history_view(parameters))),
        "tracks": jsonable(tracks),
        "frames_revision": state,
    }


@router.get("/frames/{frame:path}/revisions", response_model=Items[FrameRevision])
def revisions(context: Ctx, frame: str) -> dict[str, Any]:
    """Return all revisions of a frame, oldest first."""
    return {"items": jsonable([r.to_dict() for r in context.dpm.store.frames.revisions(frame)])}


@router.post(
    "/frames/{frame:path}/revisions",
    response_model=FrameRevision,
    status_code=201,
    openapi_extra=allowed("operator"),
)
def revise(context: Ctx, frame: str, body: Revision) -> Any:
    """Add a revision of the transform to the parent, for all products in the frame and its descendants."""
    return jsonable(context.dpm.frames.set_frame(frame, body, body.producer))


class PoseSeriesParameters(HistoryViewParameters):
    """One pose at ``t``, the newest one, or the poses of a span."""

    robot: Annotated[str, Field(max_length=64, description="Robot id")]
    t0: Stamp | None = Field(None, description="Start of the span: nanoseconds or RFC 3339")
    t1: Stamp | None = Field(None, description="End of the span")
    t: Stamp | None = Field(None, description="Time of one pose")
    frame: Frame = Field("site", description="Parent frame")
    child: Frame | None = Field(None, description="Child frame; default: the robot's base")
    newest: Flag = Field(False, description="Only the newest pose, composed over all moving frames")
    limit: Annotated[Whole, Field(ge=1, le=10_000)] = Field(1000, description="Largest number of poses")
    thin: Flag = Field(False, description="Every k-th pose and the last, if there are more than limit")
    limit_s: Annotated[Number, Field(ge=0, le=3600)] | None = Field(
        None, description="Largest extrapolation, seconds"
    )


@router.get("/poses", response_model=Items[Pose])
def poses(context: Ctx, parameters: Annotated[PoseSeriesParameters, Query()]) -> dict[str, Any]:
    """Return the poses of a robot's base (or of ``child``) in ``frame``: those of a span, the newest one, or
    the interpolated one at ``t``.
    """
    p, view = parameters, history_view(parameters)
    child = p.child or f"{p.robot}/base"
    if p.t is not None or p.newest:
        if p.t0 is not None or p.t1 is not None or (p.newest and p.t is not None):
            raise InputError("t and newest ask for one pose, t0 and t1 for a span: give one of the three")
        pose = context.dpm.frames.pose(p.frame, child, p.t, robot=p.robot, limit_s=p.limit_s, view=view)
        return {"items": [jsonable(pose)]}
    series = context.dpm.store.poses.series(
        p.robot, p.t0, p.t1, frame=p.frame, child=child, limit=p.limit, thin=p.thin, view=view
    )
    return {"items": jsonable([pose.to_dict() for pose in series])}
