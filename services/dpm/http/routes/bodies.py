# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/bodies`` and ``/api/v1/places``: bodies, and anchors of frames on them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.contract.queries import HistoryViewParameters
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.native_models import FrameRevision, Items
from services.dpm.queries.bodies import BodyName, NewAnchor
from services.dpm.queries.store_queries import history_view

router = APIRouter(prefix="/api/v1", tags=["bodies"])
_Finite = Annotated[float, Field(allow_inf_nan=False)]


class Body(BaseModel):
    """A body; with radii and without a CRS its longitude and latitude are those of a sphere."""

    model_config = ConfigDict(extra="forbid")

    name: BodyName
    kind: Literal["star", "planet", "dwarf_planet", "moon", "asteroid", "comet", "target"]
    naif_id: Annotated[int | None, Field(ge=-(1 << 31), lt=1 << 31)] = None
    radii_m: Annotated[list[_Finite], Field(min_length=3, max_length=3)] | None = None
    crs: Annotated[str | None, Field(max_length=20_000, description="authority:code, WKT2 or PROJJSON")] = (
        None
    )
    source: Annotated[str, Field(max_length=1000)] = ""


class NewBody(Body):
    """Definition of a body; ``mean_radius_m`` is the radius of its sphere."""

    mean_radius_m: Annotated[float | None, Field(gt=0, lt=1e10, allow_inf_nan=False)] = None


class DefinedBody(Body):
    """A stored body and its revision."""

    revision: int


class AnchorAnswer(BaseModel):
    """Location of a frame's origin, and the bearing of its y axis."""

    body: str
    lon_deg: float
    lat_deg: float
    height_m: float
    azimuth_deg: float


class GeoreferenceAnswer(BaseModel):
    """A CRS for files, and easting and northing in it as ``a x + b y + c`` of a frame's x and y."""

    wkt: str
    rows: tuple[tuple[float, float, float], tuple[float, float, float]]


class AnchoredFrame(BaseModel):
    """A frame and its anchor; ``wkt`` is the CRS of its x and y."""

    frame: str
    body: Body | None
    anchor: AnchorAnswer | None
    wkt: str
    georeference: GeoreferenceAnswer
    frames_revision: int


@router.get("/bodies", response_model=Items[Body])
def bodies(context: Ctx) -> dict[str, Any]:
    """Return the bodies that were defined or have anchors."""
    return {"items": [body.to_dict() for body in context.dpm.store.anchors.bodies().values()]}


@router.get("/bodies/{name}", response_model=Body)
def body(context: Ctx, name: str) -> dict[str, Any]:
    """Return a body, with or without anchors."""
    return context.dpm.store.anchors.body(name).to_dict()


@router.post("/bodies", response_model=DefinedBody, status_code=201, openapi_extra=allowed("operator"))
def define(context: Ctx, new: NewBody) -> dict[str, Any]:
    """Define a body that no authority lists, or a new revision of one."""
    return context.dpm.frames.define_body(new.model_dump(), "http")


@router.get("/places/{frame:path}", response_model=AnchoredFrame)
def place(context: Ctx, frame: str, parameters: Annotated[HistoryViewParameters, Query()]) -> Any:
    """Return the anchor of a frame, in the newest state of the frame tree or an earlier one."""
    return context.dpm.store.anchors.of(frame, history_view(parameters)).to_dict()


@router.put("/places/{frame:path}", response_model=FrameRevision, openapi_extra=allowed("operator"))
def anchor(context: Ctx, frame: str, new: NewAnchor) -> Any:
    """Anchor a frame on a body by a frame revision, which moves every product of the frame and of its
    descendants.
    """
    return jsonable(context.dpm.frames.anchor(frame, new, "http"))
