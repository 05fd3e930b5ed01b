# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products as STAC 1.1 items: geometry in degrees of the body, ``proj:`` in metres of the product's frame.

Where the site is not anchored an item has no geometry and no bbox, as the specification has it for what lies nowhere on
a body; ``proj:geometry`` and ``proj:bbox`` in an engineering CRS named after the frame say where it is.
"""

from __future__ import annotations

import functools
from typing import Any

from cdff_common.clock import format_stamp
from cdff_common.geodesy import Body
from services.dpm.convert import file_formats
from services.dpm.http.catalogue import Collection, Placed
from services.dpm.http.crs import code_of
from services.dpm.http.places import Places, geojson

VERSION = "1.1.0"
PROJECTION = "https://stac-extensions.github.io/projection/v2.0.0/schema.json"
TARGETS = "https://stac-extensions.github.io/ssys/v1.1.0/schema.json"
FILE = "https://stac-extensions.github.io/file/v2.1.0/schema.json"
PROCESSING = "https://stac-extensions.github.io/processing/v1.2.0/schema.json"
GEOJSON = "application/geo+json"
#: Products that have a picture.
_PICTURED = frozenset({"ElevationMap", "NavigationMap", "Pointcloud", "PoseTrajectory", "Frame"})


class ItemWriter:
    """Writes the items of one answer.

    Parameters
    ----------
    root : str
        URL of the server, with a slash.
    places : Places
    """

    def __init__(self, root: str, places: Places) -> None:
        self._root = root
        self._stac = f"{root}stac"
        self._places = places
        self._body = places.body
        self._plane = functools.cache(lambda frame: crs_fields(places.of(frame).crs))
        self._globe = {} if places.body is None else crs_fields(places.body.geographic_crs)

    def item(self, placed: Placed) -> dict[str, Any]:
        """A product as an item."""
        record, outline, h = placed.record, placed.on_body, placed.record.header
        collection = f"{self._stac}/collections/{record.product}"
        links = [
            {"rel": "self", "type": GEOJSON, "href": f"{collection}/items/{record.id}"},
            {"rel": "root", "type": "application/json", "href": self._stac},
            {"rel": "parent", "type": "application/json", "href": collection},
            {"rel": "collection", "type": "application/json", "href": collection},
            {"rel": "via", "type": "application/json", "href": f"{self._root}api/v1/products/{record.id}"},
            *(
                {"rel": "derived_from", "type": "application/json", "href": f"{self._root}api/v1/products/{i}"}
                for i in h.inputs[:100]
            ),
        ]  # fmt: skip
        item: dict[str, Any] = {
            "type": "Feature", "stac_version": VERSION, "stac_extensions": self._extensions(), "id": record.id,
            "collection": record.product, "geometry": geojson(outline), "properties": self._properties(placed),
            "links": links, "assets": self._assets(placed),
        }  # fmt: skip
        if outline is not None:
            item["bbox"] = [float(v) for v in outline.bounds]
        return item

    def collection(self, c: Collection) -> dict[str, Any]:
        """A collection."""
        url = f"{self._stac}/collections/{c.id}"
        data: dict[str, Any] = {
            "type": "Collection", "stac_version": VERSION, "stac_extensions": [], "id": c.id, "title": c.title,
            "description": c.description, "license": "other", "keywords": ["robotics", "data fusion"],
            "extent": {"spatial": {"bbox": [c.spatial_deg]}, "temporal": {"interval": [c.interval]}},
            "links": [
                {"rel": "self", "type": "application/json", "href": url},
                {"rel": "root", "type": "application/json", "href": self._stac},
                {"rel": "parent", "type": "application/json", "href": self._stac},
                {"rel": "items", "type": GEOJSON, "href": f"{url}/items"},
            ],
        }  # fmt: skip
        if self._body is not None:
            data |= {"stac_extensions": [TARGETS], "ssys:targets": [target(self._body)]}
        return data

    def _extensions(self) -> list[str]:
        return [PROJECTION, FILE, PROCESSING, *([] if self._body is None else [TARGETS])]

    def _properties(self, placed: Placed) -> dict[str, Any]:
        record, h = placed.record, placed.record.header
        properties: dict[str, Any] = {
            "datetime": format_stamp(h.t1_ns), "start_datetime": format_stamp(h.t0_ns),
            "end_datetime": format_stamp(h.t1_ns), "title": f"{record.product} of {record.robot}",
            "platform": record.robot, "instruments": [f"{record.dfpc}/{record.port}"],
            "processing:facility": record.dfpc, "processing:software": {"producer": h.producer or record.dfpc},
            "cdff:type_name": record.type_name, "cdff:frame": h.frame, "cdff:status": str(h.quality.status),
            "cdff:reasons": list(h.quality.reasons), "cdff:config_hash": h.config_hash,
        }  # fmt: skip
        if h.resolution_m is not None:
            properties["gsd"] = h.resolution_m
        if h.child is not None:
            properties["cdff:child"] = h.child
        if self._body is not None:
            properties |= {"ssys:targets": [target(self._body)], "cdff:geographic_crs": code_of(self._body)}
        return properties | self._projection(placed)

    def _projection(self, placed: Placed) -> dict[str, Any]:
        found = {"proj:code": None, **self._plane(placed.record.header.frame)}
        if placed.in_frame is None:
            return found
        bounds = [float(v) for v in placed.in_frame.bounds]
        return found | {"proj:geometry": geojson(placed.in_frame), "proj:bbox": bounds}

    def _assets(self, placed: Placed) -> dict[str, Any]:
        record = placed.record
        url = f"{self._root}api/v1/products/{record.id}"
        footprint: dict[str, Any] = {
            "href": f"{self._root}ogc/collections/{record.product}/items/{record.id}", "type": GEOJSON,
            "title": "Footprint", "roles": ["metadata"],
        }  # fmt: skip
        if self._body is not None and placed.on_body is not None:
            footprint |= {
                "proj:code": code_of(self._body), **self._globe, "proj:geometry": geojson(placed.on_body),
                "proj:bbox": [float(v) for v in placed.on_body.bounds],
            }  # fmt: skip
        assets: dict[str, Any] = {"footprint": footprint}
        if not record.size:
            return assets
        assets["payload"] = {
            "href": f"{url}/payload", "type": "application/octet-stream", "roles": ["data"],
            "title": f"{record.type_name} as {record.codec}", "file:size": record.size,
            "file:checksum": f"1220{record.sha256}",
        }  # fmt: skip
        for name, media_type in file_formats(record.type_name).items():
            assets[name] = {
                "href": f"{url}/payload?format={name}", "type": media_type, "title": name, "roles": ["data"],
            }  # fmt: skip
        if record.type_name in _PICTURED:
            assets["thumbnail"] = {
                "href": f"{url}/thumbnail.png", "type": "image/png", "title": "Seen from above", "roles": ["thumbnail"],
            }  # fmt: skip
        return assets


def crs_fields(crs: Any) -> dict[str, Any]:
    """A CRS as the projection extension has it."""
    return {"proj:wkt2": crs.to_wkt("WKT2_2019"), "proj:projjson": crs.to_json_dict()}


def target(body: Body) -> str:
    """Name of a body as the solar system extension has it."""
    return body.name.replace("_", " ").title()
