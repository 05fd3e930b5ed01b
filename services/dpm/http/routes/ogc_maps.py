# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/ogc``: tiles of maps (OGC API Tiles 1.0, 20-057) and windows of their values as coverages.

Collections with maps are those of ``dem`` and ``navigation_map``; each layer of tiles is a style of one.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.clock import format_stamp
from cdff_common.contract.parameters import Robot, Stamp
from cdff_common.contract.queries import (
    NavigationWindowParameters,
    Resolution,
    WindowParameters,
)
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.formats.geotiff import write_bands
from cdff_common.geometry import checked_frame
from cdff_common.raster import GridGeometry
from services.dpm.http.context import Context, Ctx
from services.dpm.http.converted_files import file_response
from services.dpm.http.html_pages import NegotiatedRoute
from services.dpm.http.models import JSON, Json, Link
from services.dpm.http.ogc.coverages import (
    DegreeGrid,
    domain_set,
    elevation_extent,
    range_type,
    resolution_deg,
    sampled,
)
from services.dpm.http.ogc.crs import CrsList, lonlat
from services.dpm.http.ogc.wmts import GRID
from services.dpm.http.routes.maps import origin_headers
from services.dpm.http.routes.ogc import base_url
from services.dpm.http.routes.tiles import (
    TileParameters,
    body_matrix_set,
    grid_in,
    matrix_set,
    tile_address,
    tile_response,
)
from services.dpm.http.stac.catalogue import numbers_of, span_of
from services.dpm.rendering.convert import Converted, convert
from services.dpm.rendering.tiles import CLASSES, LAYERS, MEDIA_TYPES, RELIEF

router = APIRouter(prefix="/ogc", tags=["ogc"], route_class=NegotiatedRoute)

_REL = "http://www.opengis.net/def/rel/ogc/1.0"
#: Layer of the tiles of a collection.
DEFAULT_LAYERS = {"dem": RELIEF, "navigation_map": CLASSES}
Name = Annotated[str, Path(max_length=64)]
Frame = Annotated[str, Query(max_length=128, description="Frame of the grid; default: site")]
_PICTURES: dict[int | str, Json] = {
    200: {"description": "256 x 256 cells", "content": {"image/png": {}, MEDIA_TYPES["tif"]: {}}},
    304: {"description": "Not modified"},
}
_TIFF: dict[int | str, Json] = {
    200: {
        "description": "The cells",
        "content": {"image/tiff; application=geotiff; profile=cloud-optimized": {}},
    }
}


class TilesetLinks(BaseModel):
    """A list of tilesets, or of tile matrix sets."""

    tilesets: list[Json] | None = None
    tileMatrixSets: list[Json] | None = None
    links: list[Link] = []


class MapTileParameters(TileParameters):
    """Parameters of a tile of a map."""

    f: Annotated[str, Field(pattern=r"^(png|tif)$")] = Field("png", description="png or tif")


class CoverageParameters(BaseModel):
    """Parameters of a window of values."""

    model_config = ConfigDict(extra="forbid")

    bbox: Annotated[str, Field(max_length=400)] | None = Field(
        None,
        description="Four numbers west,south,east,north: longitudes and latitudes in degrees if the frame "
        "has a body, otherwise x and y in metres; default: the extent of all maps",
    )
    subset: Annotated[str, Field(max_length=200)] | None = Field(
        None, description="Lon(west:east),Lat(south:north) instead of bbox, degrees; with scaleSize"
    )
    scaleSize: Annotated[str, Field(max_length=80)] | None = Field(
        None,
        description="Lon(columns),Lat(rows): elevation in cells of equal size in degrees, as the driver "
        "OGCAPI of GDAL requests it; default: the cells of the frame",
    )
    datetime: Annotated[str, Field(max_length=100)] | None = Field(
        None, description="Captures that ended at or before a time, RFC 3339"
    )
    resolution_m: Resolution | None = Field(None, description="Cell size, metres, of finer maps")
    frame: str = Field("site", max_length=128, description="Frame of the cells")
    robot: Robot | None = Field(None, description="Only maps of this robot")
    as_of: Stamp | None = Field(None, description="State of the maps and frames at this mission time")


@router.get("/tileMatrixSets", response_model=TilesetLinks, response_model_exclude_none=True)
def tile_matrix_sets(context: Ctx, request: Request, frame: Frame = "site") -> dict[str, Any]:
    """Return the grids of tiles: that of a frame, and that of its body."""
    base = f"{base_url(request)}/tileMatrixSets"
    return {
        "tileMatrixSets": [
            {"id": name, "links": [{"rel": "self", "type": JSON, "href": f"{base}/{name}?frame={frame}"}]}
            for name in _grids(context, checked_frame(frame))
        ]
    }


@router.get("/tileMatrixSets/{grid}", response_model=dict[str, Any])
def tile_matrix_set(context: Ctx, grid: Name, frame: Frame = "site") -> dict[str, Any]:
    """Return a grid of tiles as TileMatrixSet (17-083r4)."""
    if grid == GRID:
        return matrix_set(context, frame) | {"id": GRID}
    of_body = grid_in(context, checked_frame(frame))
    if of_body is None or of_body.name != grid:
        raise ProductNotFoundError(f"no grid {grid[:64]!r} in frame {frame[:80]}")
    return body_matrix_set(of_body)


@router.get(
    "/collections/{collection}/map/tiles", response_model=TilesetLinks, response_model_exclude_none=True
)
def tilesets(context: Ctx, request: Request, collection: Name, frame: Frame = "site") -> dict[str, Any]:
    """Return the tilesets of a collection of maps, for each layer and grid."""
    layers = _layers_of(collection)
    sets = [
        _tileset(request, collection, layer, grid, uri, checked_frame(frame))
        for layer in layers
        for grid, uri in _grids(context, frame).items()
    ]
    url = f"{base_url(request)}/collections/{collection}/map/tiles"
    return {"tilesets": sets, "links": [{"rel": "self", "type": JSON, "href": url}]}


@router.get("/collections/{collection}/styles/{layer}/map/tiles/{grid}", response_model=dict[str, Any])
def tileset(
    context: Ctx, request: Request, collection: Name, layer: Name, grid: Name, frame: Frame = "site"
) -> dict[str, Any]:
    """Return the description of a tileset."""
    grids = _grids(context, checked_frame(frame))
    if layer not in _layers_of(collection) or grid not in grids:
        raise ProductNotFoundError(f"no tiles of {layer[:40]!r} in grid {grid[:64]!r}")
    return _tileset(request, collection, layer, grid, grids[grid], frame)


@router.get(
    "/collections/{collection}/styles/{layer}/map/tiles/{grid}/{z}/{row}/{column}",
    response_class=Response,
    responses=_PICTURES,
)
def map_tile(
    context: Ctx,
    request: Request,
    collection: Name,
    layer: Name,
    grid: Name,
    z: Annotated[int, Path(ge=0, le=40)],
    row: Annotated[int, Path(ge=0, lt=1 << 40)],
    column: Annotated[int, Path(ge=0, lt=1 << 40)],
    parameters: Annotated[MapTileParameters, Query()],
) -> Response:
    """Return a tile of a layer, as picture or values."""
    if layer not in _layers_of(collection):
        raise ProductNotFoundError(f"no layer {layer[:40]!r} of {collection}")
    address = tile_address(context, checked_frame(parameters.frame), grid, z, column, row)
    return tile_response(context, request, parameters.request(layer, address, parameters.f))


@router.get("/collections/{collection}/coverage", response_class=Response, responses=_TIFF)
def coverage(
    context: Ctx, request: Request, collection: Name, parameters: Annotated[CoverageParameters, Query()]
) -> Response:
    """Return the maps in a box as one GeoTIFF: of elevation with variance and count, or of classes."""
    _layers_of(collection)
    frame, p = checked_frame(parameters.frame), parameters
    _, t1_ns = span_of(p.datetime)
    window: Json = {"frame": frame}
    if p.subset is not None and p.scaleSize is None:
        raise InputError(f"subset={p.subset[:80]!r}: the parameter scaleSize is missing")
    if p.scaleSize is not None:
        grid = DegreeGrid.parse(p.bbox, p.subset, p.scaleSize)
        return _in_degrees(context, collection, p, grid)
    window["region"] = None if p.bbox is None else _region(context, frame, p.bbox)
    window |= {"t1": None if t1_ns is None else str(t1_ns), "robot": p.robot}
    window |= {"resolution_m": p.resolution_m, "as_of": None if p.as_of is None else str(p.as_of)}
    window = {name: value for name, value in window.items() if value is not None}
    retrieval = context.dpm.retrieval
    result = (
        retrieval.elevation(WindowParameters.parse(window))
        if collection == "dem"
        else retrieval.navigation(NavigationWindowParameters.parse(window))
    )
    place = retrieval.georeference(result.header.frame, "tif")
    kind = type(result.map).__name__
    body = convert(kind, "", None, "tif", None, result.header, result.map, place)
    headers = origin_headers(result.manifest())
    headers["Content-Datetime"] = f"{format_stamp(result.oldest_ns)}/{format_stamp(result.newest_ns)}"
    return file_response(context, body, f"{collection}_coverage", headers)


@router.get("/collections/{collection}/coverage/domainset", response_model=dict[str, Any])
def coverage_domain_set(
    context: Ctx, request: Request, collection: Name, frame: Frame = "site"
) -> dict[str, Any]:
    """Return the extent and the resolution of a coverage of elevation, degrees."""
    _checked_elevation(collection)
    body = elevation_extent(context, checked_frame(frame))[1].body
    assert body is not None  # the frame is anchored
    return domain_set(context, frame, CrsList(body, base_url(request)).uris[0])


@router.get("/collections/{collection}/coverage/rangetype", response_model=dict[str, Any])
def coverage_range_type(collection: Name) -> dict[str, Any]:
    """Return the bands of a coverage of elevation."""
    _checked_elevation(collection)
    return range_type()


def _checked_elevation(collection: str) -> None:
    if collection != "dem":
        raise ProductNotFoundError(f"collection {collection[:64]!r} has no coverage in degrees")


def _in_degrees(context: Context, collection: str, p: CoverageParameters, grid: DegreeGrid) -> Response:
    """Return elevation in cells of equal size in degrees; unobserved cells are NaN."""
    _checked_elevation(collection)
    extent, location = elevation_extent(context, checked_frame(p.frame))
    assert location.body is not None  # the frame is anchored
    points = location.points(grid.centres())[:, :2]
    native_m = extent.resolution_m or 1.0
    coarser = math.floor(grid.cell_deg[1] / resolution_deg(location, native_m))
    edge_m = native_m * max(coarser, 1)
    lower, upper = points.min(axis=0) - edge_m, points.max(axis=0) + edge_m
    _, t1_ns = span_of(p.datetime)
    window = {
        "frame": p.frame,
        "region": "bbox:" + ",".join(repr(float(v)) for v in (*lower, *upper)),
        "resolution_m": str(edge_m) if coarser > 1 else p.resolution_m,
        "t1": None if t1_ns is None else str(t1_ns),
        "robot": p.robot,
        "as_of": None if p.as_of is None else str(p.as_of),
    }
    known = {name: value for name, value in window.items() if value is not None}
    try:
        result = context.dpm.retrieval.elevation(WindowParameters.parse(known))
        layers = {name: result.map.layer(name) for name in result.map.layer_names}
        geometry, headers = result.map.geometry, origin_headers(result.manifest())
    except ProductNotFoundError:
        layers, geometry, headers = {}, GridGeometry(p.frame, 1.0, 0.0, 0.0, 1, 1), {}
    bands = sampled(layers, points, geometry, grid.shape)
    west, _, _, north = grid.bounds_deg
    place = (lonlat(location.body).to_wkt(), west, north, *grid.cell_deg)
    data = write_bands(bands, degrees=place, cloud_optimized=False)
    body = Converted(data, "image/tiff; application=geotiff", "tif")
    return file_response(context, body, f"{collection}_coverage", headers)


def _region(context: Context, frame: str, bbox: str) -> str:
    """Return a box in degrees as a region of an anchored frame, else a box in metres; raises InputError."""
    numbers = numbers_of(bbox) or []
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise InputError(f"bbox={bbox[:80]!r}: expected 4 numbers")
    location = context.places.of(frame)
    if location.anchor is None:
        return "bbox:" + ",".join(map(repr, numbers))
    west, south, east, north = numbers
    if not (-360.0 <= west < east <= 360.0 and -90.0 <= south < north <= 90.0):
        raise InputError(f"bbox={bbox[:80]!r}: expected west below east and south below north, degrees")
    corners = np.array([[west, south], [east, south], [east, north], [west, north]])
    points = location.points(corners)[:, :2]
    return "polygon:" + ",".join(repr(float(v)) for v in points.ravel())


def _layers_of(collection: str) -> list[str]:
    """Return the layers of a collection of maps, the default first; raises ProductNotFoundError."""
    default = DEFAULT_LAYERS.get(collection)
    if default is None:
        raise ProductNotFoundError(f"collection {collection[:64]!r} has no maps")
    return sorted((n for n, product in LAYERS.items() if product == collection), key=lambda n: n != default)


def _grids(context: Context, frame: str) -> dict[str, str | None]:
    """Return the names of the grids of a frame with the URIs of their CRSs, None for one without a name."""
    of_body = grid_in(context, frame)
    return ({} if of_body is None else {of_body.name: of_body.uri}) | {GRID: None}


def _tileset(
    request: Request, collection: str, layer: str, grid: str, uri: str | None, frame: str
) -> dict[str, Any]:
    base = base_url(request)
    url = f"{base}/collections/{collection}/styles/{layer}/map/tiles/{grid}"
    template = f"{url}/{{tileMatrix}}/{{tileRow}}/{{tileCol}}?frame={frame}"
    scheme = f"{base}/tileMatrixSets/{grid}?frame={frame}"
    links = [
        {"rel": "self", "type": JSON, "href": f"{url}?frame={frame}"},
        {"rel": f"{_REL}/tiling-scheme", "type": JSON, "href": scheme},
        {"rel": "item", "type": "image/png", "href": template, "templated": True},
        {"rel": "item", "type": MEDIA_TYPES["tif"], "href": f"{template}&f=tif", "templated": True},
    ]
    crs = {} if uri is None else {"crs": uri}
    return {
        "title": f"{layer} in {grid}",
        "dataType": "map",
        "tileMatrixSetURI": scheme,
        **crs,
        "links": links,
    }
