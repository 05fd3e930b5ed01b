# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/maps/{layer}``: windows assembled from patches, clouds of a region, elevation along a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from services.dpm.convert import file_formats
from services.dpm.http.context import Ctx
from services.dpm.http.models import Open
from services.dpm.http.routes.products import file_response
from services.dpm.parameters import GROUND, cloud_request, profile_request, window_request

router = APIRouter(prefix="/api/v1/maps", tags=["maps"])

Text = Annotated[str | None, Field(max_length=20_000)]


def _file_of(type_name: str) -> dict[int | str, dict[str, Any]]:
    media_types = ("application/octet-stream", *file_formats(type_name).values())
    return {200: {"description": "The file asked for", "content": {name: {} for name in media_types}}}


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid")

    frame: Text = Field(None, description="Frame of the answer and of the region; default: site")
    robot: Text = Field(None, description="Only what this robot measured")
    t1: Text = Field(None, description="Captures that ended by then: nanoseconds or RFC 3339")
    as_of: Text = Field(None, description="What the store knew then: nanoseconds or RFC 3339")
    frames_revision: Text = Field(None, description="Frames as they were in this state of the tree")


class _Pooled(_Asked):
    resolution_m: Text = Field(None, description="Cell size wanted, metres; coarser data come as they are")
    choice: Text = Field(None, description="In each cell pooled (default), newest, oldest or best")
    disagreement: Text = Field(None, description="Pooled cells whose patches disagree: keep (default), newest or drop")


class WindowParameters(_Pooled):
    """What a window is asked with."""

    region: Text = Field(None, description="bbox: box: circle: polygon: path: near:, metres; default: everything")
    max_age_s: Text = Field(None, description="Of the newest patch")
    min_coverage: Text = Field(None, description="0 to 1; less is 503")
    format: Annotated[str, Field(max_length=16)] = "tif"


class JudgedParameters(_Asked):
    """What a window of navigation maps is asked with."""

    region: Text = Field(None, description="bbox: box: circle: polygon: path: near:, metres; default: everything")
    resolution_m: Text = Field(None, description="Cell size wanted, metres; the worst of the cells in one counts")
    choice: Text = Field(None, description="Whose judgement a cell holds: newest (default), oldest or worst")
    max_age_s: Text = Field(None, description="Of the newest map")
    min_coverage: Text = Field(None, description="0 to 1; less is 503")
    format: Annotated[str, Field(max_length=16)] = "tif"


class CloudParameters(_Asked):
    """What a cloud is asked with."""

    region: Text = Field(None, description="bbox: box: circle: polygon: path: near:, metres; default: everything")
    t0: Text = Field(None, description="Captures that end at or after this")
    points: Text = Field(None, description="At most this many, default 1000000, up to 5000000")
    format: Annotated[str, Field(max_length=16)] = "ply"


class ProfileParameters(_Pooled):
    """What a profile is asked with."""

    path: Annotated[str, Field(max_length=20_000, description="x1,y1,x2,y2,… in frame, metres")]
    step_m: Text = Field(None, description="Between samples, metres; default: the size of a cell")


class ProfileAnswer(Open):
    """Elevation along a line: columns of one length, null where unobserved."""

    distance_m: list[float]
    x_m: list[float]
    y_m: list[float]
    mean_m: list[float | None]
    sigma_m: list[float | None]
    count: list[float]
    resolution_m: float
    coverage: float
    patches: list[str]


@router.get("/dem/window", response_class=Response, responses=_file_of("ElevationMap"))
def window(context: Ctx, asked: Annotated[WindowParameters, Query()]) -> Response:
    """The elevation of a region, assembled from every patch; ``CDFF-…`` headers say from what and how complete."""
    given = asked.model_dump(exclude_none=True, exclude={"format"})
    request = window_request(GROUND, given, context.dpm.clock.now_ns())
    answer = context.dpm.window(request, asked.format, deliver="inline")
    response = file_response(answer.body, "dem_window")
    say_origin(response, answer.metadata)
    return response


@router.get("/navigation_map/window", response_class=Response, responses=_file_of("NavigationMap"))
def navigation(context: Ctx, asked: Annotated[JudgedParameters, Query()]) -> Response:
    """Where a rover may drive in a region: each cell is what the newest map says of it, or the oldest or the worst."""
    given = asked.model_dump(exclude_none=True, exclude={"format"})
    request = window_request(GROUND, given, context.dpm.clock.now_ns(), navigation=True)
    answer = context.dpm.navigation_window(request, asked.format, deliver="inline")
    response = file_response(answer.body, "navigation_map_window")
    say_origin(response, answer.metadata)
    return response


@router.get("/pointcloud/window", response_class=Response, responses=_file_of("Pointcloud"))
def cloud(context: Ctx, asked: Annotated[CloudParameters, Query()]) -> Response:
    """The points of a region from all clouds, in one frame, thinned fairly to ``points``."""
    given = asked.model_dump(exclude_none=True, exclude={"format"})
    answer = context.dpm.cloud(cloud_request(GROUND, given), asked.format, deliver="inline")
    response = file_response(answer.body, "pointcloud_window")
    m = answer.metadata
    response.headers["CDFF-Points"], response.headers["CDFF-Points-Seen"] = str(m["points"]), str(m["points_seen"])
    response.headers["CDFF-Voxel-M"] = f"{m['voxel_m']:g}"
    return response


@router.get("/dem/profile", response_model=ProfileAnswer)
def profile(context: Ctx, asked: Annotated[ProfileParameters, Query()]) -> dict[str, Any]:
    """Elevation along a line, each sample the cell that it lies in."""
    return context.dpm.profile(profile_request(GROUND, asked.model_dump(exclude_none=True)))


def say_origin(response: Response, m: Mapping[str, Any]) -> None:
    """Say in headers what a window was made from and how complete it is."""
    response.headers["CDFF-Coverage"] = f"{m['coverage']:.4f}"
    response.headers["CDFF-Resolution-M"] = f"{m['resolution_m']:g}"
    response.headers["CDFF-Patches"] = str(len(m["patches"]))
    response.headers["CDFF-Disagreeing"] = str(m["disagreeing"])
    response.headers["CDFF-Frames-Revision"] = str(m["frames_revision"])
    response.headers["CDFF-Newest-Ns"], response.headers["CDFF-Oldest-Ns"] = str(m["newest_ns"]), str(m["oldest_ns"])
