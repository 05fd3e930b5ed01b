# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/tiles``: elevation and navigation as tiles of a frame's grid, and documents that describe them
to map clients.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import Response

from cdff_common.geometry import checked_frame
from cdff_common.raster.tiles import HALF_SIDE_M, LAST_LEVEL, TILE_CELLS, Tile, cell_m, tile_matrix_set
from services.dpm.http.context import Context, Ctx
from services.dpm.http.middleware.conditional import matches
from services.dpm.http.models import OpenModel
from services.dpm.http.native_models import Items
from services.dpm.rendering.tiles import LAYER_STYLES, LAYERS, MEDIA_TYPES, TileRequest

router = APIRouter(prefix="/tiles", tags=["tiles"])

#: Memory of the rendering of a tile.
_TILE_BYTES = 16 << 20

Frame = Annotated[str, Query(max_length=128, description="Frame of the grid; default: site")]
Value = Annotated[
    float | None, Query(allow_inf_nan=False, description="End of the colours, in the layer's unit")
]
Index = Annotated[int, Path(ge=0, lt=1 << LAST_LEVEL)]
_BYTES: dict[int | str, dict[str, Any]] = {
    200: {"description": "256 x 256 cells", "content": {media: {} for media in MEDIA_TYPES.values()}},
    304: {"description": "Not modified"},
}


class Layer(OpenModel):
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


@router.get("", response_model=Items[Layer])
def layers(request: Request, frame: Frame = "site") -> dict[str, Any]:
    """Return the layers with address templates of their tiles."""
    checked_frame(frame)
    base = str(request.base_url).rstrip("/")
    items = [
        {
            "name": name,
            "title": style.title,
            "unit": style.unit,
            "product": LAYERS[name],
            "low": style.low,
            "high": style.high,
            "minzoom": 0,
            "maxzoom": LAST_LEVEL,
            "tilejson": "3.0.0",
            "tiles": [f"{base}/tiles/{name}/{{z}}/{{x}}/{{y}}.png?frame={frame}"],
            "bounds": [-HALF_SIDE_M, -HALF_SIDE_M, HALF_SIDE_M, HALF_SIDE_M],
            "tile_size": TILE_CELLS,
            "cell_m": [cell_m(z) for z in range(LAST_LEVEL + 1)],
        }
        for name, style in LAYER_STYLES.items()
    ]
    return {"frame": frame, "items": items}


@router.get("/tile_matrix_set", response_model=dict[str, Any])
def matrix_set(context: Ctx, frame: Frame = "site") -> dict[str, Any]:
    """Return the grid of a frame as an OGC TileMatrixSet (17-083r4)."""
    import json

    import pyproj

    crs = pyproj.CRS.from_wkt(context.dpm.store.anchors.of(checked_frame(frame)).wkt)
    return tile_matrix_set(frame, {"wkt": json.loads(crs.to_json())})


@router.get("/{layer}/{z}/{x}/{y}.{form}", response_class=Response, responses=_BYTES)
def tile(
    context: Ctx,
    request: Request,
    layer: Annotated[str, Path(max_length=40)],
    z: Annotated[int, Path(ge=0, le=LAST_LEVEL)],
    x: Index,
    y: Index,
    form: Literal["png", "tif", "bin"],
    frame: Frame = "site",
    low: Value = None,
    high: Value = None,
) -> Response:
    """Return one tile: a picture (png), or the layer's values as GeoTIFF (tif) or float32 rows from the top
    (bin).
    """
    return tile_response(
        context, request, TileRequest(checked_frame(frame), layer, Tile(z, x, y), form, low, high)
    )


def tile_response(context: Context, request: Request, tile_request: TileRequest) -> Response:
    """Return a tile, or 304 if the caller has it."""
    context.dpm.budget.charge(_TILE_BYTES)
    rendered = context.dpm.tiles.get(tile_request)
    headers = {"ETag": rendered.etag, "Cache-Control": "private, no-cache"}
    if matches(request.headers.get("if-none-match"), rendered.etag):
        return Response(status_code=304, headers=headers)
    return Response(rendered.data, media_type=rendered.media_type, headers=headers)
