# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/maps`` and ``/api/v1/maps/{layer}``: map layers and windows of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic import Field

from cdff_common.contract.queries import (
    MapParameters,
    NavigationWindowParameters,
    ProfileParameters,
    WindowParameters,
)
from cdff_common.errors import ProductNotFoundError
from cdff_common.raster.cell_selection import Choice, Disagreement, NavigationChoice
from cdff_common.raster.rendering import NAVIGATION, RENDERINGS
from services.dpm.http.context import Context, Ctx, jsonable, root_path
from services.dpm.http.converted_files import file_response
from services.dpm.http.models import OpenModel, StampNs
from services.dpm.http.native_models import Items
from services.dpm.http.routes.maps import ProfileAnswer, origin_headers, profile
from services.dpm.rendering.convert import Converted
from services.dpm.rendering.tiles import LAYER_STYLES, MEDIA_TYPES, RELIEF, range_of, render_elevation
from services.dpm.rendering.tiles import LAYERS as TILES

router = APIRouter(prefix="/api/v1/maps", tags=["maps"])

#: Product type of each layer.
LAYERS = {**TILES, "pointcloud": "pointcloud"}
_HEIGHTS = (RELIEF, "elevation")
_PICTURE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The picture or its values",
        "content": {MEDIA_TYPES[form]: {} for form in ("png", "tif")},
    }
}
Color = Annotated[
    float | None, Field(allow_inf_nan=False, description="End of the colours, in the layer's unit")
]


class LayerExtent(OpenModel):
    """Stored extent of a layer in one frame."""

    frame: str
    box_m: list[float] | None
    resolution_m: float | None
    t0_ns: StampNs
    newest_ns: StampNs
    count: int


class MapLayer(OpenModel):
    """A layer: its content, stored extent by frame, and links."""

    layer: str
    title: str
    unit: str
    product: str
    frames: list[LayerExtent]
    links: dict[str, str]


class PictureParameters(MapParameters):
    """A window of a layer, its format and colour limits."""

    choice: Choice | NavigationChoice | None = Field(None, description="Patches or map that determine a cell")
    disagreement: Disagreement | None = Field(
        None, description="Treatment of pooled cells whose patches disagree; for elevation"
    )
    format: Literal["png", "tif"] = "png"
    low: Color = None
    high: Color = None


def _known(layer: Annotated[str, Path(description=f"One of {', '.join(LAYERS)}")]) -> str:
    if layer not in LAYERS:
        raise ProductNotFoundError(f"no layer {layer[:40]!r}; known are {', '.join(LAYERS)}")
    return layer


Layer = Annotated[str, Depends(_known)]


@router.get("", response_model=Items[MapLayer])
def layers(context: Ctx, request: Request) -> dict[str, Any]:
    """Return the layers with their stored extents, and links to windows, profiles, tiles and products."""
    return {"items": [_described(context, name, root_path(request)) for name in LAYERS]}


@router.get("/{layer}", response_model=MapLayer)
def layer_of(context: Ctx, request: Request, layer: Layer) -> Any:
    """Return one layer: extent, smallest cell and newest capture in each frame, and links."""
    return _described(context, layer, root_path(request))


@router.get("/{layer}/window", response_class=Response, responses=_PICTURE)
def window(context: Ctx, layer: Layer, parameters: Annotated[PictureParameters, Query()]) -> Response:
    """Return a region of a layer, rendered like its tiles; cells at the edge have no slope."""
    if layer not in RENDERINGS and layer not in NAVIGATION:
        raise ProductNotFoundError(
            f"layer {layer} has no window of its own: ask /api/v1/products?type={LAYERS[layer]}"
        )
    limits = range_of(layer, parameters.low, parameters.high)
    window_parameters = parameters.model_dump(
        exclude_unset=True, exclude_none=True, exclude={"format", "low", "high"}
    )
    result = (
        context.dpm.retrieval.navigation(NavigationWindowParameters.parse(window_parameters))
        if layer in NAVIGATION
        else context.dpm.retrieval.elevation(WindowParameters.parse(window_parameters))
    )
    layers = {name: result.map.layer(name) for name in result.map.layer_names}
    if layer not in NAVIGATION:  # the renderings expect a margin of one unknown cell
        layers = {name: np.pad(layers[name], 1, constant_values=np.nan) for name in ("mean", "variance")}
    place = context.dpm.retrieval.georeference(result.header.frame, parameters.format)
    data = render_elevation(layer, parameters.format, limits, layers, result.map.geometry, place)
    body = Converted(data, MEDIA_TYPES[parameters.format], parameters.format)
    return file_response(context, body, f"{layer}_window", origin_headers(result.manifest()))


@router.get("/{layer}/profile", response_model=ProfileAnswer)
def profile_of(
    context: Ctx, layer: Layer, parameters: Annotated[ProfileParameters, Query()]
) -> dict[str, Any]:
    """Return the elevation along a path; only layers of heights have it."""
    if layer not in _HEIGHTS:
        raise ProductNotFoundError(f"layer {layer} has no profile; those with one are {', '.join(_HEIGHTS)}")
    return profile(context, parameters)


def _described(context: Context, name: str, root: str) -> Any:
    product = LAYERS[name]
    frames = [
        {
            "frame": e.frame,
            "box_m": e.box_m,
            "resolution_m": e.resolution_m,
            "t0_ns": e.t0_ns,
            "newest_ns": e.t1_ns,
            "count": e.count,
        }
        for e in context.extents.get(context.dpm.store)
        if e.product == product
    ]
    base = f"{root}/api/v1/maps/{name}"
    links = {"self": base, "products": f"{root}/api/v1/products?type={product}", "window": f"{base}/window"}
    if name in _HEIGHTS:
        links["profile"] = f"{base}/profile"
    style = LAYER_STYLES.get(name)
    if style is not None:
        links["tiles"] = f"{root}/tiles/{name}/{{z}}/{{x}}/{{y}}.png"
    title, unit = ("Points", "m") if style is None else (style.title, style.unit)
    return jsonable(
        {"layer": name, "title": title, "unit": unit, "product": product, "frames": frames, "links": links}
    )
