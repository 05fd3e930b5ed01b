# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/maps`` and ``/api/v1/maps/{layer}``: the layers there are, and windows of those that tiles are drawn of."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, Path, Query, Response
from pydantic import Field

from cdff_common.errors import ProductNotFoundError
from cdff_common.raster.rendering import NAVIGATION, RENDERINGS
from services.dpm.convert import Converted
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.models import Open, StampNs
from services.dpm.http.routes.maps import ProfileAnswer, ProfileParameters, WindowParameters, profile, say_origin
from services.dpm.http.routes.products import file_response
from services.dpm.parameters import GROUND, window_request
from services.dpm.tiles import LAYERS as TILES
from services.dpm.tiles import LOOKS, MEDIA_TYPES, RELIEF, drawn, drawn_judgement, range_of

router = APIRouter(prefix="/api/v1/maps", tags=["maps"])

#: Layer -> product that it is made from.
LAYERS = {**TILES, "pointcloud": "pointcloud"}
_HEIGHTS = (RELIEF, "elevation")
_PICTURE: dict[int | str, dict[str, Any]] = {
    200: {"description": "The picture or its values", "content": {MEDIA_TYPES[form]: {} for form in ("png", "tif")}}
}
Color = Annotated[float | None, Field(allow_inf_nan=False, description="End of the colours, in the layer's unit")]


class Held(Open):
    """What is held of a layer in one frame."""

    frame: str
    box_m: list[float] | None
    resolution_m: float | None
    t0_ns: StampNs
    newest_ns: StampNs
    count: int


class MapLayer(Open):
    """A layer: what it shows, what is held of it by frame, and where it is to be had."""

    layer: str
    title: str
    unit: str
    product: str
    frames: list[Held]
    links: dict[str, str]


class MapLayers(Open):
    """All layers."""

    items: list[MapLayer]


class PictureParameters(WindowParameters):
    """What a window of a layer is asked with."""

    format: Literal["png", "tif"] = "png"
    low: Color = None
    high: Color = None


def _known(layer: Annotated[str, Path(description=f"One of {', '.join(LAYERS)}")]) -> str:
    if layer not in LAYERS:
        raise ProductNotFoundError(f"no layer {layer[:40]!r}; known are {', '.join(LAYERS)}")
    return layer


Layer = Annotated[str, Depends(_known)]


@router.get("", response_model=MapLayers)
def layers(context: Ctx) -> dict[str, Any]:
    """The layers there are, with what is held of each and links to windows, profiles, tiles and products."""
    return {"items": [_described(context, name) for name in LAYERS]}


@router.get("/{layer}", response_model=MapLayer)
def layer_of(context: Ctx, layer: Layer) -> dict[str, Any]:
    """One layer: extent, smallest cell and newest capture in each frame, and links to what is to be had of it."""
    return _described(context, layer)


@router.get("/{layer}/window", response_class=Response, responses=_PICTURE)
def window(context: Ctx, layer: Layer, asked: Annotated[PictureParameters, Query()]) -> Response:
    """A region of a layer as tiles draw it; cells at the rim have no slope. Of navigation maps one judges each cell."""
    if layer not in RENDERINGS and layer not in NAVIGATION:
        raise ProductNotFoundError(f"layer {layer} has no window of its own: ask /api/v1/products?type={LAYERS[layer]}")
    limits = range_of(layer, asked.low, asked.high)
    given = asked.model_dump(exclude_none=True, exclude={"format", "low", "high"})
    judged = layer in NAVIGATION
    request = window_request(GROUND, given, context.dpm.clock.now_ns(), navigation=judged)
    found = context.dpm.navigation(request) if judged else context.dpm.elevation(request)
    wkt = context.dpm.crs_wkt(found.header.frame, asked.format)
    if judged:
        layers = {name: found.map.layer(name) for name in found.map.layer_names}
        data = drawn_judgement(layer, asked.format, limits, layers, found.map.geometry, wkt)
    else:
        # A margin of one cell, of which nothing is known, as the renderings want it.
        mean, variance = (np.pad(found.map.layer(name), 1, constant_values=np.nan) for name in ("mean", "variance"))
        data = drawn(layer, asked.format, limits, mean, variance, found.map.geometry, wkt)
    response = file_response(Converted(data, MEDIA_TYPES[asked.format], asked.format), f"{layer}_window")
    say_origin(response, found.manifest())
    return response


@router.get("/{layer}/profile", response_model=ProfileAnswer)
def profile_of(context: Ctx, layer: Layer, asked: Annotated[ProfileParameters, Query()]) -> dict[str, Any]:
    """Elevation along a line, as of ``dem``; other layers have none."""
    if layer not in _HEIGHTS:
        raise ProductNotFoundError(f"layer {layer} has no profile; those with one are {', '.join(_HEIGHTS)}")
    return profile(context, asked)


def _described(context: Context, name: str) -> dict[str, Any]:
    product = LAYERS[name]
    frames = [
        {"frame": e.frame, "box_m": e.box_m, "resolution_m": e.resolution_m, "t0_ns": e.t0_ns, "newest_ns": e.t1_ns,
         "count": e.count}
        for e in context.extents.get(context.dpm.store) if e.product == product
    ]  # fmt: skip
    base = f"/api/v1/maps/{name}"
    links = {"self": base, "products": f"/api/v1/products?type={product}", "window": f"{base}/window"}
    if name in _HEIGHTS:
        links["profile"] = f"{base}/profile"
    look = LOOKS.get(name)
    if look is not None:
        links["tiles"] = f"/tiles/{name}/{{z}}/{{x}}/{{y}}.png"
    title, unit = ("Points", "m") if look is None else (look.title, look.unit)
    told: dict[str, Any] = jsonable(
        {"layer": name, "title": title, "unit": unit, "product": product, "frames": frames, "links": links}
    )
    return told
