# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Location of a frame on a body: longitude, latitude and height of its origin, and azimuth of its y axis.

The CRS of an anchored frame is the local orthographic projection of the body onto the tangent plane at the
frame's origin (EPSG:1130; without rotation and height EPSG:9840, which older programs support too): easting
and northing are x and y of the frame. It is exact for points at the frame's height (Snyder 1987,
doi:10.3133/pp1395, ch. 20).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geodesy.bodies import Body
from cdff_common.geodesy.georeference import Georeference
from cdff_common.geometry import se3

FloatArray = NDArray[np.float64]
#: Height and azimuth below which a frame is treated as on the ellipsoid and oriented to the north.
_NO_HEIGHT_M, _NO_AZIMUTH_DEG = 1e-9, 1e-9


@dataclass(frozen=True, slots=True)
class Anchor:
    """Location of a z-up frame on a body.

    Attributes
    ----------
    body : Body
    lon_deg, lat_deg : float
        Longitude and latitude of the frame's origin: east positive; planetocentric on a sphere,
        planetographic on an ellipsoid.
    height_m : float
        Height above the sphere or ellipsoid of the body.
    azimuth_deg : float
        Bearing of the frame's y axis, clockwise from north: 0 for x east and y north.

    Raises
    ------
    InputError
        If a number is out of range, or the body has no longitude and latitude.
    """

    body: Body
    lon_deg: float
    lat_deg: float
    height_m: float = 0.0
    azimuth_deg: float = 0.0

    def __post_init__(self) -> None:
        _, polar_m = self.body.axes_m
        numbers = (self.lon_deg, self.lat_deg, self.height_m, self.azimuth_deg)
        if not (
            np.isfinite(numbers).all()
            and abs(self.lon_deg) <= 360.0
            and abs(self.lat_deg) <= 90.0
            and abs(self.azimuth_deg) <= 360.0
            and abs(self.height_m) < polar_m
        ):
            raise InputError(
                f"anchor at lon {self.lon_deg}, lat {self.lat_deg}, height {self.height_m} m, azimuth "
                f"{self.azimuth_deg}: expected degrees, latitude within 90, and metres above the "
                "body's surface"
            )

    @classmethod
    def from_transform(cls, body: Body, T_body_frame: ArrayLike) -> Anchor:
        """Return the anchor of a frame with a known pose in the body frame; its tilt is ignored.

        Raises
        ------
        InputError
            If the frame is at the body's centre, or its y axis is vertical.
        """
        T = np.asarray(T_body_frame, dtype=np.float64)
        lon_deg, lat_deg, height_m = _to_lonlat(body, T[None, :3, 3])[0]
        y = _horizon(lon_deg, lat_deg).T @ T[:3, 1]
        if np.hypot(y[0], y[1]) < 1e-6:
            raise InputError(f"frame on {body.name}: its y axis is vertical, so it has no azimuth")
        azimuth_deg = float(np.rad2deg(np.arctan2(y[0], y[1])))
        return cls(body, float(lon_deg), float(lat_deg), float(height_m), azimuth_deg)

    @property
    def T_body_frame(self) -> FloatArray:
        """Return the pose ``(4, 4)`` of the frame in the body frame, metres."""
        a = np.deg2rad(self.azimuth_deg)
        R_horizon_frame = np.array(
            [[np.cos(a), np.sin(a), 0.0], [-np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]]
        )
        origin = _from_lonlat(self.body, np.array([[self.lon_deg, self.lat_deg, self.height_m]]))[0]
        return se3.transform(_horizon(self.lon_deg, self.lat_deg) @ R_horizon_frame, origin)

    @property
    def crs(self) -> Any:
        """``pyproj.CRS`` whose easting and northing are the frame's x and y, metres."""
        return _project(self)

    @property
    def wkt(self) -> str:
        """WKT2 of ``crs``."""
        return str(self.crs.to_wkt("WKT2_2019"))

    @property
    def georeference(self) -> Georeference:
        """Orthographic CRS about the origin, which programs of before 2025 support, and the axes in it."""
        plain = Anchor(self.body, self.lon_deg, self.lat_deg)
        if _is_plain(self):
            return Georeference(plain.wkt)
        azimuth = np.deg2rad(self.azimuth_deg)
        c, s = np.array([np.cos(azimuth), np.sin(azimuth)]) / (1.0 + self.height_m / self.body.axes_m[0])
        return Georeference(plain.wkt, ((float(c), float(s), 0.0), (-float(s), float(c), 0.0)))

    def lonlat(self, points_m: ArrayLike) -> FloatArray:
        """Return longitude, latitude (degrees) and height (metres) ``(n, 3)`` of points ``(n, 2)`` or ``(n,
        3)``.
        """
        points = _with_height(points_m)
        return _to_lonlat(self.body, se3.transform_points(self.T_body_frame, points))

    def points(self, lonlat: ArrayLike) -> FloatArray:
        """Return points ``(n, 3)``, metres, of longitude, latitude and height (by default that of the
        origin).
        """
        coordinates = np.atleast_2d(np.asarray(lonlat, dtype=np.float64))
        if coordinates.shape[1] == 2:
            coordinates = np.column_stack([coordinates, np.full(len(coordinates), self.height_m)])
        return se3.transform_points(se3.inverse(self.T_body_frame), _from_lonlat(self.body, coordinates))

    def to_dict(self) -> dict[str, Any]:
        """Return the dict form for MessagePack and JSON."""
        return asdict(self) | {"body": self.body.name}


def _is_plain(anchor: Anchor) -> bool:
    """Return whether the frame is on the ellipsoid and faces north."""
    return abs(anchor.height_m) < _NO_HEIGHT_M and abs(anchor.azimuth_deg) < _NO_AZIMUTH_DEG


def _with_height(points_m: ArrayLike) -> FloatArray:
    points = np.atleast_2d(np.asarray(points_m, dtype=np.float64))
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InputError(f"points: shape {points.shape}, expected (n, 2) or (n, 3)")
    return points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))])


def _horizon(lon_deg: float, lat_deg: float) -> FloatArray:
    """Return east, north and up at a location, as columns in axes of the body."""
    lon, lat = np.deg2rad(lon_deg), np.deg2rad(lat_deg)
    east = [-np.sin(lon), np.cos(lon), 0.0]
    north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
    up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    return np.array([east, north, up]).T


@lru_cache(maxsize=64)
def _cart(equatorial_m: float, polar_m: float) -> Any:
    from pyproj import Transformer

    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        f"+step +proj=cart +a={equatorial_m!r} +b={polar_m!r}"
    )


def _from_lonlat(body: Body, lonlat: FloatArray) -> FloatArray:
    return np.column_stack(_cart(*body.axes_m).transform(lonlat[:, 0], lonlat[:, 1], lonlat[:, 2]))


def _to_lonlat(body: Body, points_m: FloatArray) -> FloatArray:
    coordinates = _cart(*body.axes_m).transform(
        points_m[:, 0], points_m[:, 1], points_m[:, 2], direction="INVERSE"
    )
    return np.column_stack(coordinates)


@lru_cache(maxsize=256)
def _project(anchor: Anchor) -> Any:
    """Return the coordinate reference system of the plane tangent to the body at an anchor."""
    import pyproj

    base = anchor.body.geographic_crs
    equatorial_m, _ = anchor.body.axes_m
    degree, metre = "degree", "metre"
    if _is_plain(anchor):
        method = {"name": "Orthographic", "id": {"authority": "EPSG", "code": 9840}}
        parameters = [
            ("Latitude of natural origin", 8801, anchor.lat_deg, degree),
            ("Longitude of natural origin", 8802, anchor.lon_deg, degree),
            ("False easting", 8806, 0.0, metre),
            ("False northing", 8807, 0.0, metre),
        ]
    else:
        method = {"name": "Local Orthographic", "id": {"authority": "EPSG", "code": 1130}}
        parameters = [
            ("Latitude of projection centre", 8811, anchor.lat_deg, degree),
            ("Longitude of projection centre", 8812, anchor.lon_deg, degree),
            ("Azimuth at projection centre", 8813, anchor.azimuth_deg, degree),
            ("Scale factor at projection centre", 8815, 1.0 + anchor.height_m / equatorial_m, "unity"),
            ("Easting at projection centre", 8816, 0.0, metre),
            ("Northing at projection centre", 8817, 0.0, metre),
        ]
    return pyproj.CRS.from_json_dict(
        {
            "$schema": "https://proj.org/schemas/v0.7/projjson.schema.json",
            "type": "ProjectedCRS",
            "name": f"Site on {anchor.body.name} at {anchor.lon_deg:.6f}, {anchor.lat_deg:.6f}",
            "base_crs": base.to_json_dict(),
            "conversion": {
                "name": "Tangent plane of the site",
                "method": method,
                "parameters": [
                    {"name": name, "value": value, "unit": unit, "id": {"authority": "EPSG", "code": code}}
                    for name, code, value, unit in parameters
                ],
            },
            "coordinate_system": {
                "subtype": "Cartesian",
                "axis": [
                    {"name": "Easting", "abbreviation": "E", "direction": "east", "unit": metre},
                    {"name": "Northing", "abbreviation": "N", "direction": "north", "unit": metre},
                ],
            },
        }
    )
