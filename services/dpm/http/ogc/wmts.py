# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The capabilities document of WMTS 1.0.0 (OGC 07-057r7) for the tiles of a frame, and exception reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import quote
from xml.etree import ElementTree as ET

from cdff_common.geodesy.body_grid import LAST_BODY_LEVEL, BodyGrid
from cdff_common.raster.tiles import HALF_SIDE_M, LAST_LEVEL, TILE_CELLS, cell_m
from services.dpm.rendering.tiles import LAYER_STYLES, LAYERS

_WMTS, _OWS, _XLINK = (
    "http://www.opengis.net/wmts/1.0",
    "http://www.opengis.net/ows/1.1",
    "http://www.w3.org/1999/xlink",
)
#: Size of a pixel on which the scale denominators of WMTS are based (OGC 07-057r7).
_PIXEL_M = 0.00028
#: Name of the tile matrix set of a frame.
GRID = "grid"
#: Value of the dimension of time for all maps.
CURRENT = "current"


@dataclass(frozen=True, slots=True)
class MatrixSet:
    """A tile matrix set: ``cells_m`` are the edges of its cells at each level, metres.

    Attributes
    ----------
    name : str
    crs : str
        URN; of a CRS without a name its WKT, which GDAL accepts.
    half_side_m : float
        Distance of its sides from the origin of the CRS.
    """

    name: str
    crs: str
    half_side_m: float
    cells_m: tuple[float, ...]


def matrix_sets(wkt: str, grid: BodyGrid | None) -> tuple[MatrixSet, ...]:
    """Return the tile matrix sets: the grid of the body, if any, and the grid of the frame, whose CRS has no
    name.

    QGIS accepts CRSs by their names only; it shows the second grid in the CRS of the project.
    """
    of_frame = MatrixSet(GRID, wkt, HALF_SIDE_M, tuple(cell_m(z) for z in range(LAST_LEVEL + 1)))
    if grid is None:
        return (of_frame,)
    cells = tuple(grid.cell_m(z) for z in range(LAST_BODY_LEVEL + 1))
    return MatrixSet(grid.name, grid.urn, grid.half_side_m, cells), of_frame


def capabilities(
    base: str,
    frame: str,
    sets: Sequence[MatrixSet],
    boxes: Mapping[str, Sequence[float]],
    times: Sequence[str],
    default_time: str = CURRENT,
) -> bytes:
    """Return the WMTS capabilities document with all layers.

    Parameters
    ----------
    base : str
        Address of the server, without a slash at the end.
    frame : str
    sets : sequence of MatrixSet
        The first one is that of programs which do not choose.
    boxes : mapping of str to 4 floats
        West, south, east and north of the maps of a product type, in the CRS of the first set.
    times : sequence of str
        Start of the first and end of the last capture.
    default_time : str
        Time of the tiles that a program without a choice of dimensions, such as GDAL, requests.
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
        if LAYERS[name] in boxes and sets[0].name != GRID:
            west, south, east, north = boxes[LAYERS[name]]
            box = ET.SubElement(layer, f"{{{_OWS}}}BoundingBox", {"crs": sets[0].crs})
            _text(box, _OWS, "LowerCorner", f"{west!r} {south!r}")
            _text(box, _OWS, "UpperCorner", f"{east!r} {north!r}")
        _text(layer, _OWS, "Identifier", name)
        style_element = ET.SubElement(layer, f"{{{_WMTS}}}Style", {"isDefault": "true"})
        _text(style_element, _OWS, "Identifier", "default")
        legend = {"format": "image/png", f"{{{_XLINK}}}href": f"{base}/tiles/{name}/legend.png"}
        ET.SubElement(style_element, f"{{{_WMTS}}}LegendURL", legend)
        _text(layer, _WMTS, "Format", "image/png")
        _add_time(layer, times, default_time)
        for matrix_set in sets:
            link = ET.SubElement(layer, f"{{{_WMTS}}}TileMatrixSetLink")
            _text(link, _WMTS, "TileMatrixSet", matrix_set.name)
        template = f"{base}/tiles/{name}/{{TileMatrix}}/{{TileCol}}/{{TileRow}}.png?frame={quote(frame)}"
        address = f"{template}&grid={{TileMatrixSet}}&time={{Time}}"
        resource = {"format": "image/png", "resourceType": "tile", "template": address}
        ET.SubElement(layer, f"{{{_WMTS}}}ResourceURL", resource)
    for matrix_set in sets:
        _add_matrix_set(contents, matrix_set)
    end = {f"{{{_XLINK}}}href": f"{base}/wmts/1.0.0/WMTSCapabilities.xml?frame={quote(frame)}"}
    ET.SubElement(root, f"{{{_WMTS}}}ServiceMetadataURL", end)
    return _document(root)


def _add_time(layer: ET.Element, times: Sequence[str], default: str) -> None:
    """Add the dimension of time: all maps, or those that were captured until a time."""
    dimension = ET.SubElement(layer, f"{{{_WMTS}}}Dimension")
    _text(dimension, _OWS, "Identifier", "Time")
    _text(dimension, _OWS, "UOM", "ISO8601")
    _text(dimension, _WMTS, "Default", default)
    for value in dict.fromkeys((default, CURRENT, *times)):
        _text(dimension, _WMTS, "Value", value)


def _add_matrix_set(contents: ET.Element, matrix_set: MatrixSet) -> None:
    element = ET.SubElement(contents, f"{{{_WMTS}}}TileMatrixSet")
    _text(element, _OWS, "Identifier", matrix_set.name)
    _text(element, _OWS, "SupportedCRS", matrix_set.crs)
    for z, size_m in enumerate(matrix_set.cells_m):
        matrix = ET.SubElement(element, f"{{{_WMTS}}}TileMatrix")
        _text(matrix, _OWS, "Identifier", str(z))
        values = {
            "ScaleDenominator": repr(size_m / _PIXEL_M),
            "TopLeftCorner": f"{-matrix_set.half_side_m!r} {matrix_set.half_side_m!r}",
            "TileWidth": TILE_CELLS,
            "TileHeight": TILE_CELLS,
            "MatrixWidth": 1 << z,
            "MatrixHeight": 1 << z,
        }
        for name, value in values.items():
            _text(matrix, _WMTS, name, str(value))


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
