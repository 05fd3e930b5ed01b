# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products and tracks as GeoJSON features in the requested CRS."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import shapely
from fastapi import Response
from shapely.geometry.base import BaseGeometry

from cdff_common.clock import format_stamp
from cdff_common.errors import InputError
from services.dpm.http.geographic_outlines import geojson
from services.dpm.http.models import GEOJSON, JSON, geojson_response
from services.dpm.http.ogc.crs import CRS84, CrsList
from services.dpm.http.ogc.tracks import TRACKS, TrackRecord
from services.dpm.http.stac.catalogue import OutlinedProduct

#: Media type of JSON-FG (OGC 21-045r1).
JSONFG = "application/vnd.ogc.fg+json"
#: Properties of footprints and of trajectories, with their types in JSON Schema.
PROPERTIES = {
    **dict.fromkeys(("robot", "dfpc", "port", "product", "type_name", "frame", "child"), "string"),
    **dict.fromkeys(("t0", "t1", "status"), "string"),
    **dict.fromkeys(("resolution_m", "zmin_m", "zmax_m"), "number"),
    "size_bytes": "integer",
    **dict.fromkeys(("producer", "payload", "outline_m"), "string"),
}
TRACK_PROPERTIES = {
    **dict.fromkeys(("robot", "child", "parent", "source", "t0", "t1"), "string"),
    "poses": "integer",
    "outline_m": "string",
}


class FeatureWriter:
    """Writes the features of one answer.

    Parameters
    ----------
    base : str
        URL of the interface.
    crs_list : CrsList or None
        None if no frame is anchored: features then have ``outline_m`` instead of a geometry.
    crs : str or None
        URI of the requested CRS.
    properties : frozenset of str, optional
        Names of the properties of the features; all by default.
    has_geometry : bool
        Whether features have a geometry.
    is_jsonfg : bool
        Whether features are those of JSON-FG: coordinates that are not of WGS 84 are in ``place``.
    """

    def __init__(
        self,
        base: str,
        crs_list: CrsList | None,
        crs: str | None,
        *,
        properties: frozenset[str] | None = None,
        has_geometry: bool = True,
        is_jsonfg: bool = False,
    ) -> None:
        self._base = base
        self._properties, self._has_geometry, self._is_jsonfg = properties, has_geometry, is_jsonfg
        self.crs_list = crs_list
        if crs_list is None and crs is not None:
            raise InputError(
                f"crs={crs[:120]!r}: the site is not anchored on a body, so that features have no coordinates"
            )
        self.crs = None if crs_list is None else crs_list.by_uri(crs)
        self._convert = None if crs_list is None or self.crs is None else crs_list.from_degrees(self.crs)

    def degrees(self, bbox: list[float] | None, crs: str | None) -> list[float] | None:
        """Return a box of the CRS ``crs`` in degrees; raises InputError."""
        if bbox is None or self.crs_list is None:
            return bbox
        return self.crs_list.bounds_to_degrees(bbox, self.crs_list.by_uri(crs, "bbox-crs"))

    def footprint(self, product: OutlinedProduct, collection: str) -> dict[str, Any]:
        """Return the footprint of a product as a feature of a collection."""
        record = product.record
        feature = self._feature(
            collection, record.id, product.in_frame, self._on_body(product), self.properties(product)
        )
        if self._is_jsonfg:
            f = record.fields
            self._add_place(feature, product.in_frame, f["frame"], f["t0_ns"], f["t1_ns"], record.product)
        return feature

    def row(self, product: OutlinedProduct) -> tuple[str, BaseGeometry | None, dict[str, Any]]:
        """Return the id, geometry in degrees and properties of a product."""
        outline = None if product.in_frame is None else shapely.to_wkt(product.in_frame, rounding_precision=4)
        return product.record.id, self._on_body(product), self.properties(product) | {"outline_m": outline}

    def properties(self, product: OutlinedProduct) -> dict[str, Any]:
        """Return the properties of a product, without ``outline_m``."""
        record, fields = product.record, product.record.fields
        box_m = fields.get("box_m")
        return {
            **record.names,
            "type_name": record.type_name,
            "frame": fields["frame"],
            "child": fields.get("child"),
            "t0": format_stamp(fields["t0_ns"]),
            "t1": format_stamp(fields["t1_ns"]),
            "status": str(fields["quality"]["status"]),
            "resolution_m": fields.get("resolution_m"),
            "zmin_m": None if box_m is None else box_m[2],
            "zmax_m": None if box_m is None else box_m[5],
            "size_bytes": record.size,
            "producer": fields["producer"],
            "payload": self._base.removesuffix("/ogc") + f"/api/v1/products/{record.id}/payload",
        }

    def _on_body(self, product: OutlinedProduct) -> BaseGeometry | None:
        is_on_body = self.crs_list is not None and product.body == self.crs_list.body
        return product.in_degrees if is_on_body else None

    def track(self, record: TrackRecord) -> dict[str, Any]:
        """Return a trajectory as a line."""
        track = record.track
        properties = {
            "robot": track.robot,
            "child": track.child,
            "parent": track.parent,
            "source": track.source,
            "t0": format_stamp(track.t0_ns),
            "t1": format_stamp(track.t1_ns),
            "poses": track.count,
        }
        feature = self._feature(TRACKS, record.id, record.in_frame, record.in_degrees, properties)
        if self._is_jsonfg:
            self._add_place(feature, record.in_frame, track.parent, track.t0_ns, track.t1_ns, TRACKS)
        return feature

    def response(self, body: dict[str, Any], links: Sequence[dict[str, str]]) -> Response:
        """Return GeoJSON with its CRS and links as headers."""
        headers = {
            "Link": ", ".join(
                f'<{link["href"]}>; rel="{link["rel"]}"; type="{link["type"]}"' for link in links
            )
        }
        if self.crs is not None:
            headers["Content-Crs"] = f"<{self.crs.uri}>"
        if self._is_jsonfg:
            body["conformsTo"] = ["http://www.opengis.net/spec/json-fg-1/1.0/conf/core"]
            if self.crs is not None:
                body["coordRefSys"] = self.crs.uri
        response = geojson_response(body, headers)
        if self._is_jsonfg:
            response.headers["Content-Type"] = JSONFG
        return response

    def _add_place(
        self,
        feature: dict[str, Any],
        in_frame: BaseGeometry | None,
        frame: str,
        t0_ns: int,
        t1_ns: int,
        feature_type: str,
    ) -> None:
        """Move coordinates to ``place``, those of a frame without a place on the body with its own CRS."""
        feature["time"] = {"interval": [format_stamp(t0_ns), format_stamp(t1_ns)]}
        feature["featureType"] = feature_type
        feature["place"], geometry = None, feature["geometry"]
        if geometry is not None and self.crs is not None and self.crs.uri != CRS84:
            feature["geometry"], feature["place"] = None, geometry
        elif geometry is None and in_frame is not None and self._has_geometry:
            feature["place"] = geojson(in_frame)
            feature["coordRefSys"] = f"{self._base}/crs/frame/{frame}"

    def _feature(
        self,
        collection: str,
        feature_id: str,
        in_frame: BaseGeometry | None,
        in_degrees: BaseGeometry | None,
        properties: dict[str, Any],
    ) -> dict[str, Any]:
        geometry = in_degrees if self._has_geometry else None
        if geometry is not None and self._convert is not None:
            geometry = shapely.transform(geometry, self._convert)
        url = f"{self._base}/collections/{collection}"
        links = [
            {"href": f"{url}/items/{feature_id}", "rel": "self", "type": GEOJSON},
            {"href": url, "rel": "collection", "type": JSON},
        ]
        if self._properties is None or "outline_m" in self._properties:
            # GeoJSON has no coordinates in a frame without a CRS
            outline_m = None if in_frame is None else shapely.to_wkt(in_frame, rounding_precision=4)
            properties = properties | {"outline_m": outline_m}
        if self._properties is not None:
            properties = {name: value for name, value in properties.items() if name in self._properties}
        return {
            "type": "Feature",
            "id": feature_id,
            "geometry": geojson(geometry),
            "properties": properties,
            "links": links,
        }
