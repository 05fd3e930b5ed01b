# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of products to STAC 1.1 items.

``geometry`` and ``bbox`` are longitudes and latitudes on the body in degrees; ``proj:geometry`` and
``proj:bbox`` are metres in the CRS of its frame. If the frame is not anchored on a body, an item has no
``geometry`` and no ``bbox``, as STAC requires for items without a location; the ``proj:`` fields then refer
to an engineering CRS named after the frame.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import shapely

from cdff_common.clock import format_stamp
from cdff_common.geodesy import Body
from services.dpm.http.geographic_outlines import ProductOutlines, geojson
from services.dpm.http.models import GEOJSON, JSON
from services.dpm.http.ogc.crs import code_of
from services.dpm.http.stac.catalogue import Collection, OutlinedProduct
from services.dpm.rendering.convert import file_formats

VERSION = "1.1.0"
PROJECTION = "https://stac-extensions.github.io/projection/v2.0.0/schema.json"
TARGETS = "https://stac-extensions.github.io/ssys/v1.1.0/schema.json"
FILE = "https://stac-extensions.github.io/file/v2.1.0/schema.json"
PROCESSING = "https://stac-extensions.github.io/processing/v1.2.0/schema.json"
#: Largest number of inputs that an item names.
_MAX_INPUTS = 100
#: Types with a thumbnail.
_PICTURED = frozenset({"ElevationMap", "NavigationMap", "Pointcloud", "PoseTrajectory", "Frame"})


class ItemWriter:
    """Writes the items of one answer.

    Parameters
    ----------
    root : str
        URL of the server, with a slash.
    places : ProductOutlines
    """

    def __init__(self, root: str, places: ProductOutlines) -> None:
        self._root = root
        self._stac = f"{root}stac"
        self._places = places
        self._live: frozenset[str] = frozenset()  # inputs of the products that exist
        self._body = places.body
        self._place = functools.cache(lambda frame: places.of(frame).georeference)
        self._plane = functools.cache(lambda frame: crs_fields(self._place(frame).crs))
        self._code = functools.cache(code_of)
        self._globe = functools.cache(lambda body: crs_fields(body.geographic_crs))

    def items(self, products: Sequence[OutlinedProduct]) -> list[dict[str, Any]]:
        """Return the STAC items of products; their inputs are looked up once."""
        inputs = {i for product in products for i in product.record.header.inputs[:_MAX_INPUTS]}
        self._live = self._places.live(inputs)
        return [self.item(product) for product in products]

    def item(self, product: OutlinedProduct) -> dict[str, Any]:
        """Return the STAC item of a product."""
        record, outline, h = product.record, product.in_degrees, product.record.header
        collection = f"{self._stac}/collections/{record.product}"
        links = [
            {"rel": "self", "type": GEOJSON, "href": f"{collection}/items/{record.id}"},
            {"rel": "root", "type": JSON, "href": self._stac},
            {"rel": "parent", "type": JSON, "href": collection},
            {"rel": "collection", "type": JSON, "href": collection},
            {"rel": "via", "type": JSON, "href": f"{self._root}api/v1/products/{record.id}"},
            *(
                {
                    "rel": "derived_from",
                    "type": JSON,
                    "href": f"{self._root}api/v1/products/{i}",
                }
                for i in h.inputs[:_MAX_INPUTS]
                if i in self._live
            ),
        ]
        item: dict[str, Any] = {
            "type": "Feature",
            "stac_version": VERSION,
            "stac_extensions": [PROJECTION, FILE, PROCESSING, *([] if product.body is None else [TARGETS])],
            "id": record.id,
            "collection": record.product,
            "geometry": geojson(outline),
            "properties": self._properties(product),
            "links": links,
            "assets": self._assets(product),
        }
        if outline is not None:
            item["bbox"] = [float(v) for v in outline.bounds]
        return item

    def collection(self, c: Collection) -> dict[str, Any]:
        """Return the STAC collection of a product type."""
        url = f"{self._stac}/collections/{c.id}"
        data: dict[str, Any] = {
            "type": "Collection",
            "stac_version": VERSION,
            "stac_extensions": [],
            "id": c.id,
            "title": c.title,
            "description": c.description,
            "license": "other",
            "keywords": ["robotics", "data fusion"],
            "extent": {"spatial": {"bbox": [c.spatial_deg]}, "temporal": {"interval": [c.interval]}},
            "links": [
                {"rel": "self", "type": JSON, "href": url},
                {"rel": "root", "type": JSON, "href": self._stac},
                {"rel": "parent", "type": JSON, "href": self._stac},
                {"rel": "items", "type": GEOJSON, "href": f"{url}/items"},
            ],
        }
        if self._body is not None:
            data |= {"stac_extensions": [TARGETS], "ssys:targets": [target(self._body)]}
        return data

    def _properties(self, product: OutlinedProduct) -> dict[str, Any]:
        record, h = product.record, product.record.header
        properties: dict[str, Any] = {
            "datetime": format_stamp(h.t1_ns),
            "start_datetime": format_stamp(h.t0_ns),
            "end_datetime": format_stamp(h.t1_ns),
            "title": f"{record.product} of {record.robot}",
            "platform": record.robot,
            "instruments": [f"{record.dfpc}/{record.port}"],
            "processing:facility": record.dfpc,
            "processing:software": {"producer": h.producer or record.dfpc},
            "cdff:type_name": record.type_name,
            "cdff:frame": h.frame,
            "cdff:status": str(h.quality.status),
            "cdff:reasons": list(h.quality.reasons),
            "cdff:config_hash": h.config_hash,
        }
        if h.inputs:
            properties["cdff:inputs"] = list(h.inputs[:_MAX_INPUTS])
        if h.resolution_m is not None:
            properties["gsd"] = h.resolution_m
        if h.child is not None:
            properties["cdff:child"] = h.child
        if h.signature is not None:
            properties["cdff:signature"] = h.signature
        if product.body is not None:
            properties |= {
                "ssys:targets": [target(product.body)],
                "cdff:geographic_crs": self._code(product.body),
            }
        return properties | self._projection(product)

    def _projection(self, product: OutlinedProduct) -> dict[str, Any]:
        fields = {"proj:code": None, **self._plane(product.record.header.frame)}
        if product.in_frame is None:
            return fields
        place = self._place(product.record.header.frame)
        outline = shapely.transform(product.in_frame, place.coordinates)
        return fields | {"proj:geometry": geojson(outline), "proj:bbox": [float(v) for v in outline.bounds]}

    def _assets(self, product: OutlinedProduct) -> dict[str, Any]:
        record = product.record
        url = f"{self._root}api/v1/products/{record.id}"
        footprint: dict[str, Any] = {
            "href": f"{self._root}ogc/collections/{record.product}/items/{record.id}",
            "type": GEOJSON,
            "title": "Footprint",
            "roles": ["metadata"],
        }
        if product.body is not None and product.in_degrees is not None:
            footprint |= {
                "proj:code": self._code(product.body),
                **self._globe(product.body),
                "proj:geometry": geojson(product.in_degrees),
                "proj:bbox": [float(v) for v in product.in_degrees.bounds],
            }
        assets: dict[str, Any] = {"footprint": footprint}
        if not record.size:
            return assets
        assets["payload"] = {
            "href": f"{url}/payload",
            "type": "application/octet-stream",
            "roles": ["data"],
            "title": f"{record.type_name} as {record.codec}",
            "file:size": record.size,
            "file:checksum": f"1220{record.sha256}",
        }
        for name, media_type in file_formats(record.type_name).items():
            assets[name] = {
                "href": f"{url}/payload?format={name}",
                "type": media_type,
                "title": name,
                "roles": ["data"],
            }
        if record.type_name in _PICTURED:
            assets["thumbnail"] = {
                "href": f"{url}/thumbnail.png",
                "type": "image/png",
                "title": "Seen from above",
                "roles": ["thumbnail"],
            }
        return assets


def crs_fields(crs: Any) -> dict[str, Any]:
    """Return the fields of the STAC projection extension for a CRS."""
    return {"proj:wkt2": crs.to_wkt("WKT2_2019"), "proj:projjson": crs.to_json_dict()}


def target(body: Body) -> str:
    """Return the name of a body in the STAC solar system extension."""
    return body.name.replace("_", " ").title()
