# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""GeoJSON in a frame's own metres: paths, outlines, and areas of the ground.

RFC 7946 knows longitude and latitude on Earth only. Sites of other bodies are metres in a frame, so the collection
names its CRS as GeoJSON of 2008 did, by WKT: GDAL and QGIS read it and put nothing on Earth. A reader that knows only
RFC 7946 does not: ``cdff`` says the frame once more.
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
    from cdff_common.types import GroundAreas, PoseTrajectory, TransformWithCovariance

Feature = dict[str, Any]


def write_geojson(features: Iterable[Feature], frame: str, wkt: str | None = None) -> bytes:
    """Bytes of a collection of features in a frame, metres."""
    crs = {"type": "name", "properties": {"name": wkt or engineering_crs(frame)}}
    about = {"frame": frame, "unit": "m"}
    collection = {"type": "FeatureCollection", "name": frame, "crs": crs, "cdff": about, "features": list(features)}
    return (json.dumps(collection, allow_nan=False) + "\n").encode()


def feature(kind: str, coordinates: Any, properties: Mapping[str, Any]) -> Feature:
    """One feature; ``kind`` as ``Polygon``."""
    return {
        "type": "Feature",
        "properties": dict(properties),
        "geometry": {"type": kind, "coordinates": np.asarray(coordinates).tolist()},
    }


def outline(ring_m: ArrayLike, properties: Mapping[str, Any]) -> Feature:
    """A polygon of a ring ``(n, 2)`` that does not repeat its first corner."""
    ring = np.asarray(ring_m, dtype=np.float64)
    return feature("Polygon", [np.vstack([ring, ring[:1]]).tolist()], properties)


def path_feature(trajectory: PoseTrajectory) -> Feature:
    """A trajectory as a line with heights; ``stamps_ns`` of its points as decimals."""
    positions = trajectory.matrices[:, :3, 3]
    properties = {"child": trajectory.child_frame, "stamps_ns": [str(s) for s in trajectory.stamps_ns]}
    return feature("LineString" if len(positions) > 1 else "MultiPoint", positions, properties)


def pose_feature(pose: TransformWithCovariance) -> Feature:
    """A pose as a point with height, and the turn about z of its x axis."""
    T = pose.transform.matrix
    heading = float(np.degrees(np.arctan2(T[1, 0], T[0, 0])))
    properties = {"child": pose.child_frame, "stamp_ns": str(pose.stamp_ns), "yaw_deg": heading}
    return feature("Point", T[:3, 3], properties)


def area_features(areas: GroundAreas) -> list[Feature]:
    """Each area as a polygon with its kind and size."""
    columns = zip(areas.data.kinds.tolist(), areas.data.areas.tolist(), areas.polygons, strict=True)
    return [
        {
            "type": "Feature",
            "properties": {"class": kind, "name": AreaKind(kind).name.lower(), "area_m2": round(area_m2, 6)},
            "geometry": {"type": "Polygon", "coordinates": [np.vstack([r, r[:1]]).tolist() for r in rings]},
        }
        for kind, area_m2, rings in columns
    ]
