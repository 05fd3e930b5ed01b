# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/wmts``: WMTS 1.0.0 (OGC 07-057r7) in both encodings, key-value pairs and RESTful.

Names of key-value pairs may be in any case and unknown ones are ignored (OGC 06-121r9 §11.5.2). ``FRAME``
selects the frame in any address. Errors are exception reports.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import Response
from pydantic import ValidationError

from cdff_common.clock import format_stamp
from cdff_common.contract.parameters import validation_message
from cdff_common.errors import InputError
from cdff_common.geometry import checked_frame
from services.dpm.http.context import Context, Ctx
from services.dpm.http.ogc.wmts import CURRENT, GRID, capabilities, exception_report, matrix_sets
from services.dpm.http.routes.tiles import TileParameters, grid_in, tile_address, tile_response
from services.dpm.http.stac.catalogue import Catalogue
from services.dpm.rendering.tiles import LAYERS, TileRequest

router = APIRouter(tags=["tiles"])

_PAIRS: dict[str, Any] = {
    "parameters": [
        {
            "name": "pairs",
            "in": "query",
            "style": "form",
            "explode": True,
            "description": "Key-value pairs of WMTS: SERVICE, REQUEST (GetCapabilities or GetTile), LAYER, "
            "STYLE, FORMAT, TILEMATRIXSET, TILEMATRIX, TILEROW, TILECOL, TIME; and FRAME, by default site, "
            "ROBOT, AS_OF, QUALITY, LOW, HIGH; TIME of GetCapabilities is the default of the tiles",
            "schema": {"type": "object", "additionalProperties": {"type": "string", "maxLength": 128}},
        }
    ]
}
_BODIES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "WMTS capabilities, or a tile",
        "content": {"application/xml": {}, "image/png": {}, "image/tiff; application=geotiff": {}},
    },
    304: {"description": "Not modified"},
}
#: Pairs that select maps and colours, in addition to those of WMTS.
_SELECTION = (
    *("time", "robot", "as_of", "quality", "low", "high", "interval_m", "since", "observer"),
    *("observer_height_m", "target_height_m", "range_m"),
)
_FORMS = {"image/png": "png", "image/tiff": "tif"}


@router.get("/wmts", response_class=Response, responses=_BODIES, openapi_extra=_PAIRS)
@router.get("/tiles/wmts.xml", response_class=Response, responses=_BODIES, openapi_extra=_PAIRS)
@router.get(
    "/wmts/1.0.0/WMTSCapabilities.xml", response_class=Response, responses=_BODIES, openapi_extra=_PAIRS
)
def wmts(context: Ctx, request: Request) -> Response:
    """Return the capabilities document, which QGIS and GDAL open directly, or the tile of key-value pairs."""
    pairs = {name.upper(): value for name, value in request.query_params.items()}
    try:
        return _answer(context, request, pairs)
    except InputError as error:
        return Response(exception_report(str(error)), 400, media_type="application/xml")


def _answer(context: Context, request: Request, pairs: dict[str, str]) -> Response:
    """Return the answer to upper-case key-value pairs; raises InputError."""
    if pairs.get("SERVICE", "WMTS").upper() != "WMTS":
        raise InputError(f"SERVICE={pairs['SERVICE'][:40]!r}: expected WMTS")
    frame = checked_frame(pairs.get("FRAME", "site"))
    operation = pairs.get("REQUEST", "GetCapabilities")
    if operation == "GetCapabilities":
        parameters = _tile_parameters({"time": pairs.get("TIME", CURRENT)})
        _ = parameters.state  # a malformed time is refused here, not in each tile
        document = _capabilities(context, request, frame, parameters.time)
        return Response(document, media_type="application/xml")
    if operation != "GetTile":
        raise InputError(f"REQUEST={operation[:40]!r}: expected GetCapabilities or GetTile")
    return tile_response(context, request, _tile(context, pairs, frame))


def _capabilities(context: Context, request: Request, frame: str, default_time: str) -> bytes:
    grid = grid_in(context, frame)
    products = set(LAYERS.values())
    layers = [layer for layer in Catalogue(context).collections() if layer.id in products]
    boxes = {}
    for layer in layers:
        if grid is not None and layer.bounds_deg is not None:
            west, south, east, north = layer.bounds_deg
            corners = grid.from_lonlat(np.array([[west, south], [east, north]]))
            boxes[layer.id] = corners.ravel().tolist()
    times = []
    if layers:
        times = [
            format_stamp(min(layer.t0_ns for layer in layers)),
            format_stamp(max(layer.t1_ns for layer in layers)),
        ]
    sets = matrix_sets(context.places.of(frame).wkt, grid)
    return capabilities(str(request.base_url).rstrip("/"), frame, sets, boxes, times, default_time)


def _tile(context: Context, pairs: dict[str, str], frame: str) -> TileRequest:
    """Return the tile of a GetTile request; raises InputError if a value is missing or unknown."""
    form = pairs.get("FORMAT", "image/png").partition(";")[0]
    if form not in _FORMS:
        raise InputError(f"FORMAT={form[:40]!r}: expected one of {', '.join(_FORMS)}")
    z, row, column = (_number(pairs, name) for name in ("TILEMATRIX", "TILEROW", "TILECOL"))
    tile_values = {name: pairs[name.upper()] for name in _SELECTION if name.upper() in pairs}
    parameters = _tile_parameters(tile_values | {"frame": frame})
    address = tile_address(context, frame, pairs.get("TILEMATRIXSET", GRID), z, column, row)
    return parameters.request(pairs.get("LAYER", ""), address, _FORMS[form])


def _tile_parameters(values: dict[str, str]) -> TileParameters:
    """Return the parameters of a tile; raises InputError if one is malformed."""
    try:
        return TileParameters.model_validate(values)
    except ValidationError as error:
        raise InputError(validation_message(error.errors()[0])) from error


def _number(pairs: dict[str, str], name: str) -> int:
    text = pairs.get(name, "")
    if not (text.isdecimal() and len(text) < 10):
        raise InputError(f"{name}={text[:40]!r}: expected a whole number")
    return int(text)
