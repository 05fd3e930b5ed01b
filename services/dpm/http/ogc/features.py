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
from services.dpm.http.ogc.crs import CrsList
from services.dpm.http.ogc.tracks import TRACKS, TrackRecord
from services.dpm.http.stac.catalogue import OutlinedProduct


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
    """

    def __init__(self, base: str, crs_list: CrsList | None, crs: str | None) -> None:
        self._base = base
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

    def footprint(self, product: OutlinedProduct) -> dict[str, Any]:
        """Return the footprint of a product as a feature."""
        record, h = product.record, product.record.header
        properties = {
            **record.names,
            "type_name": record.type_name,
            "frame": h.frame,
            "child": h.child,
            "t0": format_stamp(h.t0_ns),
            "t1": format_stamp(h.t1_ns),
            "status": str(h.quality.status),
            "resolution_m": h.resolution_m,
            "zmin_m": None if h.box_m is None else h.box_m[2],
            "zmax_m": None if h.box_m is None else h.box_m[5],
            "size_bytes": record.size,
            "producer": h.producer,
            "payload": self._base.removesuffix("/ogc") + f"/api/v1/products/{record.id}/payload",
        }
        is_on_body = self.crs_list is not None and product.body == self.crs_list.body
        in_degrees = product.in_degrees if is_on_body else None
        return self._feature(record.product, record.id, product.in_frame, in_degrees, properties)

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
        return self._feature(TRACKS, record.id, record.in_frame, record.in_degrees, properties)

    def response(self, body: dict[str, Any], links: Sequence[dict[str, str]]) -> Response:
        """Return GeoJSON with its CRS and links as headers."""
        headers = {
            "Link": ", ".join(
                f'<{link["href"]}>; rel="{link["rel"]}"; type="{link["type"]}"' for link in links
            )
        }
        if self.crs is not None:
            headers["Content-Crs"] = f"<{self.crs.uri}>"
        return geojson_response(body, headers)

    def _feature(
        self,
        collection: str,
        feature_id: str,
        in_frame: BaseGeometry | None,
        in_degrees: BaseGeometry | None,
        properties: dict[str, Any],
    ) -> dict[str, Any]:
        geometry = (
            in_degrees
            if in_degrees is None or self._convert is None
            else shapely.transform(in_degrees, self._convert)
        )
        url = f"{self._base}/collections/{collection}"
        links = [
            {"href": f"{url}/items/{feature_id}", "rel": "self", "type": GEOJSON},
            {"href": url, "rel": "collection", "type": JSON},
        ]
        # No standard covers coordinates in a frame without a CRS.
        outline_m = None if in_frame is None else shapely.to_wkt(in_frame, rounding_precision=4)
        return {
            "type": "Feature",
            "id": feature_id,
            "geometry": geojson(geometry),
            "properties": properties | {"outline_m": outline_m},
            "links": links,
        }
