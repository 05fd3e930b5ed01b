# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/tiles``: elevation and navigation as tiles of a frame's grid, and documents that lead map clients to them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import Response

from cdff_common.geometry import checked_frame
from cdff_common.raster.tiles import HALF_SIDE_M, LAST_LEVEL, TILE_CELLS, Tile, cell_m, tile_matrix_set
from services.dpm.http.conditional import matches
from services.dpm.http.context import Ctx
from services.dpm.http.models import Open
from services.dpm.http.wmts import capabilities
from services.dpm.tiles import LAYERS, LOOKS, MEDIA_TYPES, TileRequest

router = APIRouter(prefix="/tiles", tags=["tiles"])

Frame = Annotated[str, Query(max_length=128, description="Whose grid; default: site")]
Value = Annotated[float | None, Query(allow_inf_nan=False, description="End of the colours, in the layer's unit")]
Index = Annotated[int, Path(ge=0, lt=1 << LAST_LEVEL)]
_BYTES: dict[int | str, dict[str, Any]] = {
    200: {"description": "256 x 256 cells", "content": {media: {} for media in MEDIA_TYPES.values()}},
    304: {"description": "The caller has it"},
}
_XML: dict[int | str, dict[str, Any]] = {200: {"description": "WMTS capabilities", "content": {"application/xml": {}}}}


class Layer(Open):
    """A layer of tiles, as TileJSON describes one; bounds in metres of the frame."""

    name: str
    title: str
    unit: str
    product: str
    low: float
    high: float
    tiles: list[str]
    minzoom: int
    maxzoom: int
    bounds: list[float]


class Layers(Open):
    """All layers."""

    items: list[Layer]


@router.get("", response_model=Layers)
def layers(request: Request, frame: Frame = "site") -> dict[str, Any]:
    """The layers there are, with a template of their tiles' addresses."""
    checked_frame(frame)
    base = str(request.base_url).rstrip("/")
    items = []
    for name, look in LOOKS.items():
        items.append(
            {
                "name": name, "title": look.title, "unit": look.unit, "product": LAYERS[name],
                "low": look.low, "high": look.high, "minzoom": 0, "maxzoom": LAST_LEVEL, "tilejson": "3.0.0",
                "tiles": [f"{base}/tiles/{name}/{{z}}/{{x}}/{{y}}.png?frame={frame}"],
                "bounds": [-HALF_SIDE_M, -HALF_SIDE_M, HALF_SIDE_M, HALF_SIDE_M],
                "tile_size": TILE_CELLS, "cell_m": [cell_m(z) for z in range(LAST_LEVEL + 1)],
            }
        )  # fmt: skip
    return {"frame": frame, "items": items}


@router.get("/tile_matrix_set", response_model=dict[str, Any])
def matrix_set(context: Ctx, frame: Frame = "site") -> dict[str, Any]:
    """The grid of a frame as an OGC TileMatrixSet (17-083r4)."""
    import json

    import pyproj

    crs = pyproj.CRS.from_wkt(context.dpm.store.places.of(checked_frame(frame)).wkt)
    return tile_matrix_set(frame, {"wkt": json.loads(crs.to_json())})


@router.get("/wmts.xml", response_class=Response, responses=_XML)
def wmts(context: Ctx, request: Request, frame: Frame = "site") -> Response:
    """The same for clients that speak WMTS: QGIS and GDAL open it as it is."""
    wkt = context.dpm.store.places.of(checked_frame(frame)).wkt
    base = str(request.base_url).rstrip("/")
    return Response(capabilities(base, frame, wkt), media_type="application/xml")


@router.get("/{layer}/{z}/{x}/{y}.{form}", response_class=Response, responses=_BYTES)
def tile(
    context: Ctx, request: Request, layer: Annotated[str, Path(max_length=40)],
    z: Annotated[int, Path(ge=0, le=LAST_LEVEL)], x: Index, y: Index, form: Literal["png", "tif", "bin"],
    frame: Frame = "site", low: Value = None, high: Value = None,
) -> Response:  # fmt: skip
    """One tile: a picture (png), or the layer's values as GeoTIFF (tif) or float32 rows from the top (bin)."""
    asked = TileRequest(checked_frame(frame), layer, Tile(z, x, y), form, low, high)
    found = context.dpm.tiles.get(asked)
    headers = {"ETag": found.etag, "Cache-Control": "private, no-cache"}
    if matches(request.headers.get("if-none-match"), found.etag):
        return Response(status_code=304, headers=headers)
    return Response(found.data, media_type=found.media_type, headers=headers)
