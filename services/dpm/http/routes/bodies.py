# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/bodies`` and ``/api/v1/places``: bodies, and where on them frames lie."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.clock import parse_stamp
from dpm_store.frames import Known
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.native_models import FrameRevision
from services.dpm.http.roles import allowed

router = APIRouter(prefix="/api/v1", tags=["bodies"])

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Sigma = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
Stamp = Annotated[str | None, Query(max_length=40, description="Nanoseconds as a decimal, or RFC 3339")]
State = Annotated[int | None, Query(ge=0, le=1 << 40, description="State of the frame tree, of an earlier answer")]


class Body(BaseModel):
    """A body; with radii and without a CRS its longitude and latitude are those of a sphere."""

    model_config = ConfigDict(extra="forbid")

    name: Name
    kind: Literal["star", "planet", "dwarf_planet", "moon", "asteroid", "comet", "target"]
    naif_id: Annotated[int | None, Field(ge=-(1 << 31), lt=1 << 31)] = None
    radii_m: Annotated[list[Finite], Field(min_length=3, max_length=3)] | None = None
    crs: Annotated[str | None, Field(max_length=20_000, description="authority:code, WKT2 or PROJJSON")] = None
    source: Annotated[str, Field(max_length=1000)] = ""


class NewBody(Body):
    """A body as it is entered; the sphere is one of ``mean_radius_m`` where it is given."""

    mean_radius_m: Annotated[float | None, Field(gt=0, lt=1e10, allow_inf_nan=False)] = None


class Bodies(BaseModel):
    """Bodies that were entered or anchored on."""

    items: list[Body]


class DefinedBody(Body):
    """A body as it is now kept."""

    revision: int


class NewAnchor(BaseModel):
    """Where a frame is to lie: z up, y towards ``azimuth_deg`` clockwise from north."""

    model_config = ConfigDict(extra="forbid")

    body: Name
    lon_deg: Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
    lat_deg: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
    height_m: Finite = 0.0
    azimuth_deg: Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)] = 0.0
    sigma_m: Sigma = 0.0
    sigma_deg: Sigma = 0.0
    expected_revision: Annotated[int | None, Field(ge=0, lt=1 << 31)] = None


class AnchorFound(BaseModel):
    """Where a frame's origin lies, and the bearing of its y axis."""

    body: str
    lon_deg: float
    lat_deg: float
    height_m: float
    azimuth_deg: float


class PlaceFound(BaseModel):
    """Where a frame is; ``wkt`` is the CRS of its x and y."""

    frame: str
    body: Body | None
    anchor: AnchorFound | None
    wkt: str
    frames_revision: int


@router.get("/bodies", response_model=Bodies)
def bodies(context: Ctx) -> dict[str, Any]:
    """Bodies that were entered or anchored on."""
    return {"items": [body.to_dict() for body in context.dpm.store.places.bodies().values()]}


@router.get("/bodies/{name}", response_model=Body)
def body(context: Ctx, name: str) -> dict[str, Any]:
    """A body, also one that nothing is anchored on yet."""
    return context.dpm.store.places.body(name).to_dict()


@router.post("/bodies", response_model=DefinedBody, status_code=201, openapi_extra=allowed("operator"))
def define(context: Ctx, new: NewBody) -> dict[str, Any]:
    """Enter a body that no authority lists, or a new revision of one."""
    return context.dpm.define_body(new.model_dump(), "http")


@router.get("/places/{frame:path}", response_model=PlaceFound)
def place(context: Ctx, frame: str, as_of: Stamp = None, frames_revision: State = None) -> Any:
    """Where a frame is, in the newest state of the frame tree or an earlier one."""
    known = Known(None if as_of is None else parse_stamp(as_of, "as_of"), frames_revision)
    return context.dpm.store.places.of(frame, known).to_dict()


@router.put("/places/{frame:path}", response_model=FrameRevision, openapi_extra=allowed("operator"))
def anchor(context: Ctx, frame: str, new: NewAnchor) -> Any:
    """Anchor a frame on a body: one frame revision; every product of the frame and of those below moves with it."""
    return jsonable(context.dpm.anchor(frame, new.model_dump(exclude_none=True), "http"))
