# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/frames`` and ``/api/v1/poses``: fixed edges with their revisions, moving edges as time series."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.clock import parse_stamp
from cdff_common.errors import InputError
from dpm_store.frames import Known
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.native_models import FrameRevision, FrameRevisions, Frames, Poses
from services.dpm.http.roles import allowed

router = APIRouter(prefix="/api/v1", tags=["frames"])

Frame = Annotated[str, Query(max_length=128)]
Stamp = Annotated[str | None, Query(max_length=40, description="Nanoseconds as a decimal, or RFC 3339")]
State = Annotated[int | None, Query(ge=0, le=1 << 40, description="State of the frame tree, of an earlier answer")]
LimitS = Annotated[float | None, Query(ge=0, le=3600, description="How far outside its span a pose still counts")]
Row4 = Annotated[list[float], Field(min_length=4, max_length=4)]
Row6 = Annotated[list[float], Field(min_length=6, max_length=6)]


class Revision(BaseModel):
    """A new revision of a frame's fixed edge."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    parent: str
    T: Annotated[list[Row4], Field(min_length=4, max_length=4)]
    covariance: Annotated[list[Row6], Field(min_length=6, max_length=6)] | None = None
    valid_from_ns: str | None = None
    valid_until_ns: str | None = None
    expected_revision: int | None = Field(default=None, ge=0)
    producer: Annotated[str, Field(max_length=200)] = "http"


@router.get("/frames", response_model=Frames)
def frames(context: Ctx, as_of: Stamp = None, frames_revision: State = None) -> dict[str, Any]:
    """The last revision of every fixed frame (as known at ``as_of``, or in the state ``frames_revision``), and the
    spans that moving ones are known in.
    """
    known = _known(as_of, frames_revision)
    tracks = [
        {"parent": t.parent, "child": t.child, "source": t.source, "robot": t.robot, "t0_ns": t.t0_ns,
         "t1_ns": t.t1_ns, "count": t.count}
        for t in context.dpm.store.poses.tracks()
    ]  # fmt: skip
    state = context.dpm.store.frames.state() if frames_revision is None else frames_revision
    return {"items": jsonable(context.dpm.frames(known)), "tracks": jsonable(tracks), "frames_revision": state}


@router.get("/frames/{frame:path}/revisions", response_model=FrameRevisions)
def revisions(context: Ctx, frame: str) -> dict[str, Any]:
    """All revisions of a frame, oldest first."""
    return {"items": jsonable([r.to_dict() for r in context.dpm.store.frames.revisions(frame)])}


@router.post(
    "/frames/{frame:path}/revisions", response_model=FrameRevision, status_code=201, openapi_extra=allowed("operator")
)
def revise(context: Ctx, frame: str, body: Revision) -> Any:
    """Add a revision: every product of the frame and of those below moves with it."""
    data = body.model_dump() | {"frame": frame}
    for name in ("valid_from_ns", "valid_until_ns"):
        data[name] = None if data[name] is None else parse_stamp(data[name], name)
    return jsonable(context.dpm.set_frame(data))


@router.get("/poses", response_model=Poses)
def poses(
    context: Ctx, robot: Annotated[str, Query(max_length=64)], t0: Stamp = None, t1: Stamp = None, t: Stamp = None,
    frame: Frame = "site", child: Frame | None = None, limit: Annotated[int, Query(ge=1, le=10_000)] = 1000,
    limit_s: LimitS = None, as_of: Stamp = None, frames_revision: State = None,
) -> dict[str, Any]:  # fmt: skip
    """Poses of a robot's base (or of ``child``) in ``frame``: the series of a span, or the one at ``t``.

    At ``t`` it is interpolated; ``t`` farther than ``limit_s`` outside what is known is refused.
    """
    child, known = child or f"{robot}/base", _known(as_of, frames_revision)
    if t is not None:
        if t0 is not None or t1 is not None:
            raise InputError("t asks for one pose, t0 and t1 for a span: give one of the two")
        found = context.dpm.pose(frame, child, parse_stamp(t), robot=robot, limit_s=limit_s, known=known)
        return {"items": [jsonable(found)]}
    span = [None if text is None else parse_stamp(text, name) for name, text in (("t0", t0), ("t1", t1))]
    series = context.dpm.store.poses.series(robot, *span, frame=frame, child=child, limit=limit, known=known)
    return {"items": jsonable([pose.to_dict() for pose in series])}


def _known(as_of: str | None, frames_revision: int | None) -> Known:
    return Known(None if as_of is None else parse_stamp(as_of, "as_of"), frames_revision)
