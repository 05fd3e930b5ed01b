# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of products to STAC 1.1 items.

Items in lists are short: their ``geometry`` encloses the outline of the product with few corners. Detailed
items also contain coordinate reference systems, the exact outline, inputs, configuration and all files.

``geometry`` and ``bbox`` are longitudes and latitudes on the body in degrees; ``proj:geometry`` and
``proj:bbox`` are metres in the CRS of its frame. If the frame is not anchored on a body, an item has no
``geometry`` and no ``bbox``, as STAC requires for items without a location; the ``proj:`` fields then refer
to an engineering CRS named after the frame.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.clock import format_stamp
from cdff_common.geodesy import Body
from services.dpm.http.geographic_outlines import ProductOutlines, enclosing, geojson, rounded
from services.dpm.http.models import GEOJSON, JSON, QUERYABLES, SCHEMA
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
#: Decimals of degrees in lists: 0.1 mm on the Earth.
_DECIMALS = 9
_TITLES = {"footprint": "Footprint", "payload": "As stored", "thumbnail": "Seen from above"}
#: Largest number of values of a property in a summary.
_MAX_SUMMARY = 100
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
        self._formats = functools.cache(file_formats)

    def items(self, products: Sequence[OutlinedProduct], *, detailed: bool = False) -> list[dict[str, Any]]:
        """Return the STAC items of products."""
        outlines = rounded(self._enclosing(products), _DECIMALS)
        bounds = shapely.bounds(np.array(outlines, dtype=object)).tolist()
        items = [
            self._item(product, outline, box)
            for product, outline, box in zip(products, outlines, bounds, strict=True)
        ]
        if detailed:
            inputs = {i for p in products for i in p.record.fields["inputs"][:_MAX_INPUTS]}
            self._live = self._places.live(inputs)
            for product, item in zip(products, items, strict=True):
                self._add_details(product, item)
        return items

    def _enclosing(self, products: Sequence[OutlinedProduct]) -> list[BaseGeometry | None]:
        """Return the outlines in degrees, with few corners."""
        in_frame = [product.in_frame for product in products]
        simple = enclosing(in_frame)
        results = [product.in_degrees for product in products]
        changed = [
            i
            for i, (old, new) in enumerate(zip(in_frame, simple, strict=True))
            if new is not old and results[i] is not None
        ]
        frames = [products[i].record.fields["frame"] for i in changed]
        in_degrees = self._places.outlines_in_degrees(frames, [simple[i] for i in changed])
        for i, outline in zip(changed, in_degrees, strict=True):
            results[i] = outline
        return results

    def _item(self, product: OutlinedProduct, outline: BaseGeometry | None, bounds: Any) -> dict[str, Any]:
        record = product.record
        collection = f"{self._stac}/collections/{record.product}"
        item: dict[str, Any] = {
            "type": "Feature",
            "stac_version": VERSION,
            "stac_extensions": [FILE] if product.body is None else [FILE, TARGETS],
            "id": record.id,
            "collection": record.product,
            "geometry": geojson(outline),
            "properties": self._properties(product),
            "links": [
                {"rel": "self", "type": GEOJSON, "href": f"{collection}/items/{record.id}"},
                {"rel": "root", "type": JSON, "href": self._stac},
                {"rel": "parent", "type": JSON, "href": collection},
                {"rel": "collection", "type": JSON, "href": collection},
            ],
            "assets": self._assets(product),
        }
        if outline is not None:
            item["bbox"] = bounds
        return item

    def _add_details(self, product: OutlinedProduct, item: dict[str, Any]) -> None:
        """Add the fields that lists omit."""
        record, fields = product.record, product.record.fields
        inputs = fields["inputs"][:_MAX_INPUTS]
        products = f"{self._root}api/v1/products"
        item["stac_extensions"] += [PROJECTION, PROCESSING]
        item["links"] += [
            {"rel": "via", "type": JSON, "href": f"{products}/{record.id}"},
            *(
                {"rel": "derived_from", "type": JSON, "href": f"{products}/{i}"}
                for i in inputs
                if i in self._live
            ),
        ]
        if "thumbnail" in item["assets"]:
            thumbnail = item["assets"]["thumbnail"]
            item["links"].append({"rel": "preview", "type": "image/png", "href": thumbnail["href"]})
        item["properties"] |= {
            "title": f"{record.product} of {record.robot}",
            "start_datetime": format_stamp(fields["t0_ns"]),
            "end_datetime": format_stamp(fields["t1_ns"]),
            "processing:facility": record.dfpc,
            "processing:software": {"producer": fields["producer"] or record.dfpc},
            "cdff:reasons": list(fields["quality"].get("reasons", ())),
            "cdff:config_hash": fields["config_hash"],
            **self._projection(product),
        }
        if inputs:
            item["properties"]["cdff:inputs"] = list(inputs)
        if fields.get("signature") is not None:
            item["properties"]["cdff:signature"] = fields["signature"]
        if product.body is not None:
            item["properties"]["cdff:geographic_crs"] = self._code(product.body)
        item["assets"] = self._detailed_assets(product, item["assets"])

    def collection(self, collection: Collection) -> dict[str, Any]:
        """Return the STAC collection of a product type."""
        url = f"{self._stac}/collections/{collection.id}"
        data: dict[str, Any] = {
            "type": "Collection",
            "stac_version": VERSION,
            "stac_extensions": [],
            "id": collection.id,
            "title": collection.title,
            "description": collection.description,
            "license": "other",
            "keywords": ["robotics", "data fusion"],
            "extent": {
                "spatial": {"bbox": [collection.spatial_deg]},
                "temporal": {"interval": [collection.interval]},
            },
            "links": [
                {"rel": "self", "type": JSON, "href": url},
                {"rel": "root", "type": JSON, "href": self._stac},
                {"rel": "parent", "type": JSON, "href": self._stac},
                {"rel": "items", "type": GEOJSON, "href": f"{url}/items"},
                {"rel": QUERYABLES, "type": SCHEMA, "href": f"{url}/queryables"},
            ],
            "summaries": summaries(collection),
            "item_assets": self._described_assets(collection),
        }
        if self._body is not None:
            data |= {"stac_extensions": [TARGETS], "ssys:targets": [target(self._body)]}
        return data

    def _described_assets(self, collection: Collection) -> dict[str, Any]:
        """Return the files that items of a collection may have."""
        assets: dict[str, Any] = {
            "footprint": {"type": GEOJSON, "roles": ["metadata"], "title": _TITLES["footprint"]},
            "payload": {
                "type": "application/octet-stream",
                "roles": ["data"],
                "title": _TITLES["payload"],
            },
        }
        for type_name in sorted({origin.type_name for origin in collection.origins}):
            for name, media_type in self._formats(type_name).items():
                assets[name] = {"type": media_type, "roles": ["data"], "title": name}
            if type_name in _PICTURED:
                title = _TITLES["thumbnail"]
                assets["thumbnail"] = {"type": "image/png", "roles": ["thumbnail"], "title": title}
        return assets

    def _properties(self, product: OutlinedProduct) -> dict[str, Any]:
        record, fields = product.record, product.record.fields
        properties: dict[str, Any] = {
            "datetime": format_stamp(fields["t1_ns"]),
            "platform": record.robot,
            "instruments": [f"{record.dfpc}/{record.port}"],
            "cdff:type_name": record.type_name,
            "cdff:frame": fields["frame"],
            "cdff:status": fields["quality"]["status"],
        }
        if fields["t0_ns"] != fields["t1_ns"]:
            properties["start_datetime"] = format_stamp(fields["t0_ns"])
            properties["end_datetime"] = properties["datetime"]
        if fields.get("resolution_m") is not None:
            properties["gsd"] = fields["resolution_m"]
        if fields.get("child") is not None:
            properties["cdff:child"] = fields["child"]
        if product.body is not None:
            properties["ssys:targets"] = [target(product.body)]
        return properties

    def _projection(self, product: OutlinedProduct) -> dict[str, Any]:
        fields = {"proj:code": None, **self._plane(product.record.fields["frame"])}
        if product.in_frame is None:
            return fields
        place = self._place(product.record.fields["frame"])
        outline = shapely.transform(product.in_frame, place.coordinates)
        return fields | {"proj:geometry": geojson(outline), "proj:bbox": [float(v) for v in outline.bounds]}

    def _assets(self, product: OutlinedProduct) -> dict[str, Any]:
        """Return the files that lists name: the payload, its first file format, and a picture."""
        record = product.record
        if not record.size:
            return {}
        url = f"{self._root}api/v1/products/{record.id}"
        assets: dict[str, Any] = {
            "payload": {
                "href": f"{url}/payload",
                "type": "application/octet-stream",
                "roles": ["data"],
                "file:size": record.size,
            }
        }
        for name, media_type in list(self._formats(record.type_name).items())[:1]:
            assets[name] = {"href": f"{url}/payload?format={name}", "type": media_type, "roles": ["data"]}
        if record.type_name in _PICTURED:
            assets["thumbnail"] = {
                "href": f"{url}/thumbnail.png",
                "type": "image/png",
                "roles": ["thumbnail"],
            }
        return assets

    def _detailed_assets(self, product: OutlinedProduct, assets: dict[str, Any]) -> dict[str, Any]:
        """Return all files, with titles."""
        record = product.record
        footprint: dict[str, Any] = {
            "href": f"{self._root}ogc/collections/{record.product}/items/{record.id}",
            "type": GEOJSON,
            "roles": ["metadata"],
        }
        if product.body is not None and product.in_degrees is not None:
            footprint |= {
                "proj:code": self._code(product.body),
                **self._globe(product.body),
                "proj:geometry": geojson(product.in_degrees),
                "proj:bbox": [float(v) for v in product.in_degrees.bounds],
            }
        all_assets = {"footprint": footprint, **assets}
        if record.size:
            all_assets["payload"]["file:checksum"] = f"1220{record.sha256}"
            url = f"{self._root}api/v1/products/{record.id}/payload"
            for name, media_type in self._formats(record.type_name).items():
                all_assets.setdefault(
                    name, {"href": f"{url}?format={name}", "type": media_type, "roles": ["data"]}
                )
        for name, asset in all_assets.items():
            asset["title"] = _TITLES.get(name, name)
        return all_assets


def summaries(collection: Collection) -> dict[str, Any]:
    """Return the values of properties in the items of a collection."""
    values = {
        "platform": {o.robot for o in collection.origins},
        "instruments": {f"{o.dfpc}/{o.port}" for o in collection.origins},
        "cdff:type_name": {o.type_name for o in collection.origins},
        "cdff:status": {o.status for o in collection.origins},
        "cdff:frame": set(collection.frames),
    }
    data: dict[str, Any] = {
        name: sorted(of_name)[:_MAX_SUMMARY] for name, of_name in values.items() if of_name
    }
    finest = [o.finest_m for o in collection.origins if o.finest_m is not None]
    coarsest = [o.coarsest_m for o in collection.origins if o.coarsest_m is not None]
    if finest and coarsest:
        data["gsd"] = {"minimum": min(finest), "maximum": max(coarsest)}
    return data


def crs_fields(crs: Any) -> dict[str, Any]:
    """Return the fields of the STAC projection extension for a CRS."""
    return {"proj:wkt2": crs.to_wkt("WKT2_2019"), "proj:projjson": crs.to_json_dict()}


def target(body: Body) -> str:
    """Return the name of a body in the STAC solar system extension."""
    return body.name.replace("_", " ").title()
