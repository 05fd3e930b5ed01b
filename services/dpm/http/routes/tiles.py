# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/tiles``: elevation and navigation as tiles of a frame's grid, and documents that describe them
to map clients.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.contract.parameters import Number, PointM, Robot, Stamp
from cdff_common.contract.queries import MetricBounds
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geodesy.body_grid import LAST_BODY_LEVEL, BodyGrid, BodyTile, body_grid
from cdff_common.geometry import checked_frame
from cdff_common.raster.tiles import HALF_SIDE_M, LAST_LEVEL, TILE_CELLS, Tile, cell_m, tile_matrix_set
from services.dpm.http.context import Context, Ctx
from services.dpm.http.middleware.conditional import matches
from services.dpm.http.models import OpenModel
from services.dpm.http.native_models import Items
from services.dpm.http.ogc.wmts import CURRENT, GRID
from services.dpm.http.stac.catalogue import span_of
from services.dpm.rendering.tile_cells import MapState, TileAnalysis
from services.dpm.rendering.tiles import (
    LAYER_STYLES,
    MEDIA_TYPES,
    PRODUCTS,
    TileRequest,
    legend,
    legend_png,
)

router = APIRouter(prefix="/tiles", tags=["tiles"])

#: Memory for the rendering of a tile, bytes.
_TILE_BYTES = 16 << 20

Frame = Annotated[str, Query(max_length=128, description="Frame of the grid; default: site")]
Value = Annotated[
    float | None,
    Query(allow_inf_nan=False, description="Value at the lower end of the colour scale, in the layer's unit"),
]
Index = Annotated[int, Path(ge=0, lt=1 << LAST_BODY_LEVEL)]
LayerName = Annotated[str, Path(max_length=40)]
_BYTES: dict[int | str, dict[str, Any]] = {
    200: {"description": "256 x 256 cells", "content": {media: {} for media in MEDIA_TYPES.values()}},
    304: {"description": "Not modified"},
}
_PNG: dict[int | str, dict[str, Any]] = {200: {"description": "A picture", "content": {"image/png": {}}}}


class TileParameters(BaseModel):
    """Parameters of a tile; times, robot and quality select the maps in it."""

    model_config = ConfigDict(extra="forbid")

    frame: str = Field("site", max_length=128, description="Frame of the grid; default: site")
    grid: str = Field(
        GRID, max_length=64, description="Grid of the frame's body, as IAU_2015_49910; default: of the frame"
    )
    time: Annotated[str, Field(max_length=100)] = Field(
        CURRENT, description="Instead of t0 and t1: captures until a time, or in an interval, RFC 3339"
    )
    low: Annotated[float, Field(allow_inf_nan=False)] | None = Field(
        None, description="Value at the lower end of the colour scale, in the layer's unit"
    )
    high: Annotated[float, Field(allow_inf_nan=False)] | None = Field(
        None, description="Value at the upper end of the colour scale, in the layer's unit"
    )
    robot: Robot | None = Field(None, description="Only maps of this robot")
    t0: Stamp | None = Field(None, description="Captures that ended at or after this: ns or RFC 3339")
    t1: Stamp | None = Field(None, description="Captures that ended at or before this: ns or RFC 3339")
    as_of: Stamp | None = Field(None, description="State of the maps and frames at this mission time")
    quality: MetricBounds = Field(
        default_factory=tuple, description="Bounds of quality metrics, such as inliers>=30,rmse_px<0.5"
    )

    interval_m: Annotated[Number, Field(ge=1e-3, le=1e4)] | None = Field(
        None, description="Of layer contours: difference in height of two lines, metres"
    )
    since: Stamp | None = Field(
        None, description="Of layer difference: captures until this time are compared with later ones"
    )
    observer: PointM | None = Field(None, description="Of layer viewshed: x,y in frame, metres")
    observer_height_m: Annotated[Number, Field(ge=0, le=1e4)] | None = Field(
        None, description="Height of the eye above the ground; default: 2 m"
    )
    target_height_m: Annotated[Number, Field(ge=0, le=1e4)] | None = Field(
        None, description="Height above the ground that is to be seen; default: 0"
    )
    range_m: Annotated[Number, Field(gt=0, le=1e3)] | None = Field(
        None, description="Longest line of sight, metres; default: 50"
    )

    def request(self, layer: str, tile: Tile | BodyTile, form: str) -> TileRequest:
        """Return the request of a tile; raises InputError for an unknown layer or form."""
        analysis = TileAnalysis(
            self.interval_m,
            self.since,
            self.observer,
            self.observer_height_m,
            self.target_height_m,
            self.range_m,
        )
        frame = checked_frame(self.frame)
        return TileRequest(frame, layer, tile, form, self.low, self.high, self.state, analysis)

    @property
    def state(self) -> MapState:
        """The maps in the tile; raises InputError for a malformed time."""
        t0_ns, t1_ns = self.t0, self.t1
        if self.time != CURRENT:
            if t0_ns is not None or t1_ns is not None:
                raise InputError("time, and t0 or t1: give one of the two")
            first_ns, t1_ns = span_of(self.time)
            t0_ns = first_ns if "/" in self.time else None
        return MapState(self.robot, t0_ns, t1_ns, self.as_of, self.quality)


class Layer(OpenModel):
    """A layer of tiles, as TileJSON describes one; bounds in metres of the frame."""

    name: str
    title: str
    unit: str
    product: str
    low: float
    high: float
    tiles: list[str]
    legend: str
    colors: list[tuple[float, str]]
    minzoom: int
    maxzoom: int
    bounds: list[float]


@router.get("", response_model=Items[Layer])
def layers(context: Ctx, request: Request, frame: Frame = "site") -> dict[str, Any]:
    """Return the layers with address templates of their tiles, colours and legends."""
    grid = grid_in(context, checked_frame(frame))
    base = str(request.base_url).rstrip("/")
    items = [
        {
            "name": name,
            "title": style.title,
            "unit": style.unit,
            "product": PRODUCTS[name],
            "low": style.low,
            "high": style.high,
            "minzoom": 0,
            "maxzoom": LAST_LEVEL,
            "tilejson": "3.0.0",
            "tiles": [f"{base}/tiles/{name}/{{z}}/{{x}}/{{y}}.png?frame={frame}"],
            "bounds": [-HALF_SIDE_M, -HALF_SIDE_M, HALF_SIDE_M, HALF_SIDE_M],
            "tile_size": TILE_CELLS,
            "cell_m": [cell_m(z) for z in range(LAST_LEVEL + 1)],
            "legend": f"{base}/tiles/{name}/legend.png",
            "colors": legend(name),
        }
        for name, style in LAYER_STYLES.items()
    ]
    return {"frame": frame, "body_grid": None if grid is None else grid.name, "items": items}


@router.get("/tile_matrix_set", response_model=dict[str, Any])
def matrix_set(context: Ctx, frame: Frame = "site") -> dict[str, Any]:
    """Return the grid of a frame as an OGC TileMatrixSet (17-083r4)."""
    import json

    import pyproj

    crs = pyproj.CRS.from_wkt(context.dpm.store.anchors.of(checked_frame(frame)).wkt)
    return tile_matrix_set(frame, {"wkt": json.loads(crs.to_json())})


@router.get("/grid", response_model=dict[str, Any])
def grid_of_body(context: Ctx, frame: Frame = "site") -> dict[str, Any]:
    """Return the grid of the body of a frame, in a CRS that an authority names, as an OGC TileMatrixSet."""
    return body_matrix_set(required_grid(context, checked_frame(frame)))


@router.get("/{layer}/legend.png", response_class=Response, responses=_PNG)
def legend_of(layer: LayerName, low: Value = None, high: Value = None) -> Response:
    """Return the colours of a layer with the values of their ends."""
    if layer not in PRODUCTS:
        raise ProductNotFoundError(f"no layer {layer!r}: expected one of {', '.join(PRODUCTS)}")
    return Response(legend_png(layer, low, high), media_type="image/png")


@router.get("/{layer}/{z}/{x}/{y}.{form}", response_class=Response, responses=_BYTES)
def tile(
    context: Ctx,
    request: Request,
    layer: LayerName,
    z: Annotated[int, Path(ge=0, le=LAST_BODY_LEVEL)],
    x: Index,
    y: Index,
    form: Literal["png", "tif", "bin"],
    parameters: Annotated[TileParameters, Query()],
) -> Response:
    """Return one tile: a picture (png), or the layer's values as GeoTIFF (tif) or float32 rows from the top
    (bin). A tile with smaller cells than the maps in it shows these enlarged.
    """
    address = tile_address(context, checked_frame(parameters.frame), parameters.grid, z, x, y)
    return tile_response(context, request, parameters.request(layer, address, form))


def tile_address(context: Context, frame: str, grid: str, z: int, x: int, y: int) -> Tile | BodyTile:
    """Return the address of a tile of a frame's grid, or of the named grid of its body; raises InputError."""
    if grid == GRID:
        return Tile(z, x, y)
    of_body = required_grid(context, frame)
    if grid != of_body.name:
        raise InputError(f"grid={grid[:64]!r}: expected {GRID} or {of_body.name}")
    return BodyTile(of_body, z, x, y)


def grid_in(context: Context, frame: str) -> BodyGrid | None:
    """Return the grid of the body of a frame; None if the frame or its body has no such CRS."""
    location = context.places.of(frame)
    return None if location.anchor is None or location.body is None else body_grid(location.body)


def required_grid(context: Context, frame: str) -> BodyGrid:
    """Return the grid of the body of a frame; raises InputError without one."""
    grid = grid_in(context, frame)
    if grid is None:
        raise InputError(f"frame {frame}: it is not anchored on a body with a CRS of an authority")
    return grid


def body_matrix_set(grid: BodyGrid) -> dict[str, Any]:
    """Return a body's grid as an OGC TileMatrixSet: 17-083r4, with the members of 17-083r2 for GDAL 3.6."""
    half = grid.half_side_m
    corner = [-half, half]
    matrices = [
        {
            "id": str(z),
            "identifier": str(z),
            "scaleDenominator": grid.cell_m(z) / 0.00028,
            "cellSize": grid.cell_m(z),
            "cornerOfOrigin": "topLeft",
            "pointOfOrigin": corner,
            "topLeftCorner": corner,
            "tileWidth": TILE_CELLS,
            "tileHeight": TILE_CELLS,
            "matrixWidth": 1 << z,
            "matrixHeight": 1 << z,
        }
        for z in range(LAST_BODY_LEVEL + 1)
    ]
    return {
        "type": "TileMatrixSetType",
        "id": grid.name,
        "identifier": grid.name,
        "title": grid.name,
        "crs": grid.uri,
        "supportedCRS": grid.urn,
        "tileMatrices": matrices,
    }


def tile_response(context: Context, request: Request, tile_request: TileRequest) -> Response:
    """Return a tile, or 304 if the caller has it."""
    context.dpm.budget.charge(_TILE_BYTES)
    rendered = context.dpm.tiles.get(tile_request)
    headers = {"ETag": rendered.etag, "Cache-Control": "private, no-cache"}
    if matches(request.headers.get("if-none-match"), rendered.etag):
        return Response(status_code=304, headers=headers)
    return Response(rendered.data, media_type=rendered.media_type, headers=headers)
