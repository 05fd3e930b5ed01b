# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""GeoJSON in metres of a frame: paths, outlines and ground areas.

RFC 7946 supports only longitude and latitude on Earth. Sites of other bodies are in metres of a frame, so the
collection contains its CRS as WKT, as in GeoJSON of 2008, which GDAL and QGIS read. The member ``cdff``
repeats the frame for readers that support RFC 7946 only, and has the frame's axes in the CRS if they differ
from easting and northing.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.formats.geotiff import engineering_crs
from cdff_common.types.ground_areas_ext import AreaKind

if TYPE_CHECKING:
    from cdff_common.geodesy import Georeference
    from cdff_common.types import GroundAreas, PoseTrajectory, TransformWithCovariance

Feature = dict[str, Any]


def write_geojson(features: Iterable[Feature], frame: str, place: Georeference | None = None) -> bytes:
    """Return a GeoJSON collection of features in a frame, metres; by default in an engineering CRS."""
    crs = {"type": "name", "properties": {"name": engineering_crs(frame) if place is None else place.wkt}}
    frame_member: dict[str, Any] = {"frame": frame, "unit": "m"}
    if place is not None and not place.is_identity:
        frame_member["axes"] = place.rows
        features = [_transform_feature(item, place) for item in features]
    collection = {
        "type": "FeatureCollection",
        "name": frame,
        "crs": crs,
        "cdff": frame_member,
        "features": list(features),
    }
    return (json.dumps(collection, allow_nan=False) + "\n").encode()


def feature(kind: str, coordinates: Any, properties: Mapping[str, Any]) -> Feature:
    """Return one feature; ``kind`` is e.g. ``Polygon``."""
    return {
        "type": "Feature",
        "properties": dict(properties),
        "geometry": {"type": kind, "coordinates": np.asarray(coordinates).tolist()},
    }


def _transform_feature(item: Feature, place: Georeference) -> Feature:
    """Return a feature in the frame with coordinates of the CRS."""

    def convert(coordinates: Any) -> Any:
        if coordinates and not isinstance(coordinates[0], list | tuple):
            return place.coordinates(coordinates)[0].tolist()
        return [convert(part) for part in coordinates]

    geometry = item["geometry"]
    return item | {"geometry": geometry | {"coordinates": convert(geometry["coordinates"])}}


def outline(ring_m: ArrayLike, properties: Mapping[str, Any]) -> Feature:
    """Return the polygon of a ring ``(n, 2)`` that does not repeat its first corner."""
    ring = np.asarray(ring_m, dtype=np.float64)
    return feature("Polygon", [np.vstack([ring, ring[:1]]).tolist()], properties)


def path_feature(trajectory: PoseTrajectory) -> Feature:
    """Return a trajectory as a line with heights; ``stamps_ns`` of its points are decimal strings."""
    positions = trajectory.matrices[:, :3, 3]
    properties = {"child": trajectory.child_frame, "stamps_ns": [str(s) for s in trajectory.stamps_ns]}
    return feature("LineString" if len(positions) > 1 else "MultiPoint", positions, properties)


def pose_feature(pose: TransformWithCovariance) -> Feature:
    """Return a pose as a point with height, and the heading of its x axis."""
    T = pose.transform.matrix
    heading = float(np.degrees(np.arctan2(T[1, 0], T[0, 0])))
    properties = {"child": pose.child_frame, "stamp_ns": str(pose.stamp_ns), "yaw_deg": heading}
    return feature("Point", T[:3, 3], properties)


def area_features(areas: GroundAreas) -> list[Feature]:
    """Return each area as a polygon with its kind and size."""
    columns = zip(areas.data.kinds.tolist(), areas.data.areas.tolist(), areas.polygons, strict=True)
    return [
        {
            "type": "Feature",
            "properties": {"class": kind, "name": AreaKind(kind).name.lower(), "area_m2": round(area_m2, 6)},
            "geometry": {"type": "Polygon", "coordinates": [np.vstack([r, r[:1]]).tolist() for r in rings]},
        }
        for kind, area_m2, rings in columns
    ]
