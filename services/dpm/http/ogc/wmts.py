# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The capabilities document of WMTS 1.0.0 (OGC 07-057r7) for the tiles of a frame, in its RESTful form."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from cdff_common.raster.tiles import HALF_SIDE_M, LAST_LEVEL, TILE_CELLS, cell_m
from services.dpm.rendering.tiles import LAYER_STYLES

_WMTS, _OWS, _XLINK = (
    "http://www.opengis.net/wmts/1.0",
    "http://www.opengis.net/ows/1.1",
    "http://www.w3.org/1999/xlink",
)
_PIXEL_M = 0.00028


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
    contents = ET.SubElement(root, f"{{{_WMTS}}}Contents")
    for name, style in LAYER_STYLES.items():
        layer = ET.SubElement(contents, f"{{{_WMTS}}}Layer")
        _text(layer, _OWS, "Title", style.title)
        _text(layer, _OWS, "Identifier", name)
        style_element = ET.SubElement(layer, f"{{{_WMTS}}}Style", {"isDefault": "true"})
        _text(style_element, _OWS, "Identifier", "default")
        _text(layer, _WMTS, "Format", "image/png")
        link = ET.SubElement(layer, f"{{{_WMTS}}}TileMatrixSetLink")
        _text(link, _WMTS, "TileMatrixSet", "grid")
        address = f"{base}/tiles/{name}/{{TileMatrix}}/{{TileCol}}/{{TileRow}}.png?frame={frame}"
        ET.SubElement(
            layer,
            f"{{{_WMTS}}}ResourceURL",
            {"format": "image/png", "resourceType": "tile", "template": address},
        )
    grid = ET.SubElement(contents, f"{{{_WMTS}}}TileMatrixSet")
    _text(grid, _OWS, "Identifier", "grid")
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
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root)


def _text(parent: ET.Element, namespace: str, name: str, text: str) -> None:
    ET.SubElement(parent, f"{{{namespace}}}{name}").text = text
