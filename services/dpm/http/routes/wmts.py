# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/wmts``: WMTS 1.0.0 (OGC 07-057r7) in both encodings, key-value pairs and RESTful.

Names of key-value pairs may be in any case and unknown ones are ignored (OGC 06-121r9 §11.5.2). ``FRAME``
selects the frame in any address. Errors are exception reports.
"""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from cdff_common.errors import InputError
from cdff_common.geometry import checked_frame
from cdff_common.raster.tiles import LAST_LEVEL, Tile
from services.dpm.http.context import Context, Ctx
from services.dpm.http.ogc.wmts import GRID, capabilities, exception_report
from services.dpm.http.routes.tiles import tile_response
from services.dpm.rendering.tiles import TileRequest

router = APIRouter(tags=["tiles"])

_PAIRS: dict[str, Any] = {
    "parameters": [
        {
            "name": "pairs",
            "in": "query",
            "style": "form",
            "explode": True,
            "description": "Key-value pairs of WMTS: SERVICE, REQUEST (GetCapabilities or GetTile), LAYER, "
            "STYLE, FORMAT, TILEMATRIXSET, TILEMATRIX, TILEROW, TILECOL; and FRAME, by default site",
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
        wkt = context.dpm.store.anchors.of(frame).wkt
        base = str(request.base_url).rstrip("/")
        return Response(capabilities(base, frame, wkt), media_type="application/xml")
    if operation != "GetTile":
        raise InputError(f"REQUEST={operation[:40]!r}: expected GetCapabilities or GetTile")
    return tile_response(context, request, _tile(pairs, frame))


def _tile(pairs: dict[str, str], frame: str) -> TileRequest:
    """Return the tile of a GetTile request; raises InputError if a value is missing or unknown."""
    if pairs.get("TILEMATRIXSET", GRID) != GRID:
        raise InputError(f"TILEMATRIXSET={pairs['TILEMATRIXSET'][:40]!r}: expected {GRID}")
    form = pairs.get("FORMAT", "image/png").partition(";")[0]
    if form not in _FORMS:
        raise InputError(f"FORMAT={form[:40]!r}: expected one of {', '.join(_FORMS)}")
    z, row, column = (_number(pairs, name) for name in ("TILEMATRIX", "TILEROW", "TILECOL"))
    if z > LAST_LEVEL or max(row, column) >= 1 << z:
        raise InputError(
            f"TILEMATRIX={z}, TILEROW={row}, TILECOL={column}: expected a level up to {LAST_LEVEL} and a "
            "row and column of it"
        )
    return TileRequest(frame, pairs.get("LAYER", ""), Tile(z, column, row), _FORMS[form])


def _number(pairs: dict[str, str], name: str) -> int:
    text = pairs.get(name, "")
    if not (text.isdecimal() and len(text) < 10):
        raise InputError(f"{name}={text[:40]!r}: expected a whole number")
    return int(text)
