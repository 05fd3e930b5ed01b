# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The capabilities document of WMTS 1.0.0 (OGC 07-057r7) for the tiles of a frame, and exception reports."""

from __future__ import annotations

from urllib.parse import quote
from xml.etree import ElementTree as ET

from cdff_common.raster.tiles import HALF_SIDE_M, LAST_LEVEL, TILE_CELLS, cell_m
from services.dpm.rendering.tiles import LAYER_STYLES

_WMTS, _OWS, _XLINK = (
    "http://www.opengis.net/wmts/1.0",
    "http://www.opengis.net/ows/1.1",
    "http://www.w3.org/1999/xlink",
)
_PIXEL_M = 0.00028
#: Name of the tile matrix set.
GRID = "grid"


def capabilities(base: str, frame: str, wkt: str) -> bytes:
    """Return the WMTS capabilities document with all layers.

    Parameters
    ----------
    base : str
        Address of the server, without a slash at the end.
    frame : str
    wkt : str
        CRS of the frame; GDAL accepts it in place of a CRS name.
    """
    ET.register_namespace("", _WMTS)
    ET.register_namespace("ows", _OWS)
    ET.register_namespace("xlink", _XLINK)
    root = ET.Element(f"{{{_WMTS}}}Capabilities", {"version": "1.0.0"})
    identification = ET.SubElement(root, f"{{{_OWS}}}ServiceIdentification")
    _text(identification, _OWS, "Title", f"Elevation and navigation in frame {frame}")
    _text(identification, _OWS, "ServiceType", "OGC WMTS")
    _text(identification, _OWS, "ServiceTypeVersion", "1.0.0")
    operations = ET.SubElement(root, f"{{{_OWS}}}OperationsMetadata")
    for name in ("GetCapabilities", "GetTile"):
        operation = ET.SubElement(operations, f"{{{_OWS}}}Operation", {"name": name})
        http = ET.SubElement(ET.SubElement(operation, f"{{{_OWS}}}DCP"), f"{{{_OWS}}}HTTP")
        address = f"{base}/wmts?frame={quote(frame)}&"
        get = ET.SubElement(http, f"{{{_OWS}}}Get", {f"{{{_XLINK}}}href": address})
        constraint = ET.SubElement(get, f"{{{_OWS}}}Constraint", {"name": "GetEncoding"})
        _text(ET.SubElement(constraint, f"{{{_OWS}}}AllowedValues"), _OWS, "Value", "KVP")
    contents = ET.SubElement(root, f"{{{_WMTS}}}Contents")
    for name, style in LAYER_STYLES.items():
        layer = ET.SubElement(contents, f"{{{_WMTS}}}Layer")
        _text(layer, _OWS, "Title", style.title)
        _text(layer, _OWS, "Identifier", name)
        style_element = ET.SubElement(layer, f"{{{_WMTS}}}Style", {"isDefault": "true"})
        _text(style_element, _OWS, "Identifier", "default")
        _text(layer, _WMTS, "Format", "image/png")
        link = ET.SubElement(layer, f"{{{_WMTS}}}TileMatrixSetLink")
        _text(link, _WMTS, "TileMatrixSet", GRID)
        address = f"{base}/tiles/{name}/{{TileMatrix}}/{{TileCol}}/{{TileRow}}.png?frame={quote(frame)}"
        ET.SubElement(
            layer,
            f"{{{_WMTS}}}ResourceURL",
            {"format": "image/png", "resourceType": "tile", "template": address},
        )
    grid = ET.SubElement(contents, f"{{{_WMTS}}}TileMatrixSet")
    _text(grid, _OWS, "Identifier", GRID)
    _text(grid, _OWS, "SupportedCRS", wkt)
    for z in range(LAST_LEVEL + 1):
        matrix = ET.SubElement(grid, f"{{{_WMTS}}}TileMatrix")
        _text(matrix, _OWS, "Identifier", str(z))
        values = {
            "ScaleDenominator": repr(cell_m(z) / _PIXEL_M),
            "TopLeftCorner": f"{-HALF_SIDE_M!r} {HALF_SIDE_M!r}",
            "TileWidth": TILE_CELLS,
            "TileHeight": TILE_CELLS,
            "MatrixWidth": 1 << z,
            "MatrixHeight": 1 << z,
        }
        for name, value in values.items():
            _text(matrix, _WMTS, name, str(value))
    end = {f"{{{_XLINK}}}href": f"{base}/wmts/1.0.0/WMTSCapabilities.xml?frame={quote(frame)}"}
    ET.SubElement(root, f"{{{_WMTS}}}ServiceMetadataURL", end)
    return _document(root)


def exception_report(message: str) -> bytes:
    """Return an exception report of OGC Web Services Common (06-121r9 §8) for a refused value."""
    ET.register_namespace("ows", _OWS)
    root = ET.Element(f"{{{_OWS}}}ExceptionReport", {"version": "1.1.0"})
    exception = ET.SubElement(root, f"{{{_OWS}}}Exception", {"exceptionCode": "InvalidParameterValue"})
    _text(exception, _OWS, "ExceptionText", message)
    return _document(root)


def _document(root: ET.Element) -> bytes:
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root)


def _text(parent: ET.Element, namespace: str, name: str, text: str) -> None:
    ET.SubElement(parent, f"{{{namespace}}}{name}").text = text
