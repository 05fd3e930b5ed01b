# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where a site lies on its body: between metres of its plane and degrees of longitude and latitude."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyproj
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Anchor:
    """A site on a body.

    Attributes
    ----------
    body : str
        As ``Mars``.
    lon_deg, lat_deg : float
        Of the site's origin, planetocentric, east positive.
    geographic : pyproj.CRS
        Of the body; latitude before longitude where an authority defines it so.
    plane : pyproj.CRS
        The site's tangent plane, metres.
    """

    body: str
    lon_deg: float
    lat_deg: float
    geographic: Any
    plane: Any

    @functools.cached_property
    def code(self) -> str | None:
        """``IAU_2015:49900``; None for a body that no authority lists."""
        authority = self.geographic.to_authority(min_confidence=90)
        return None if authority is None else ":".join(authority)

    @functools.cached_property
    def _transformer(self) -> pyproj.Transformer:
        return pyproj.Transformer.from_crs(self.plane, self.geographic, always_xy=True)

    def to_degrees(self, xy_m: ArrayLike) -> NDArray[np.float64]:
        """``(n, 2)`` metres of the site's plane as longitudes and latitudes."""
        xy = np.asarray(xy_m, dtype=np.float64)
        return np.column_stack(self._transformer.transform(xy[:, 0], xy[:, 1]))

    def to_metres(self, lon_lat_deg: ArrayLike) -> NDArray[np.float64]:
        """``(n, 2)`` longitudes and latitudes in metres of the site's plane."""
        ll = np.asarray(lon_lat_deg, dtype=np.float64)
        return np.column_stack(self._transformer.transform(ll[:, 0], ll[:, 1], direction="INVERSE"))


_NAIF = {"mercury": 199, "venus": 299, "earth": 399, "moon": 301, "mars": 499, "phobos": 401, "ceres": 2000001}


@functools.lru_cache(maxsize=8)
def _anchor(body: str, lon_deg: float, lat_deg: float) -> Anchor:
    geographic = pyproj.CRS.from_authority("IAU_2015", _NAIF[body] * 100)
    plane = pyproj.CRS.from_proj4(
        f"+proj=ortho +lat_0={lat_deg!r} +lon_0={lon_deg!r} +R={geographic.ellipsoid.semi_major_metre!r} +type=crs"
    )
    return Anchor(body.capitalize(), lon_deg, lat_deg, geographic, plane)


def anchor_of(profile: Any) -> Anchor | None:
    if profile is None or profile.body.site_lon_deg is None:
        return None
    return _anchor(profile.body.name, profile.body.site_lon_deg, profile.body.site_lat_deg)
