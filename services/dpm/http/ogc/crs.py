# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Coordinate reference systems of a body for OGC API Features: by URI, each with its axis order.

The default is longitude before latitude, as in GeoJSON. No authority defines such a CRS for other planets
(OGC:CRS84 is that of the Earth), so the server defines it at its own URI.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geodesy import Body

_OGC = "http://www.opengis.net/def/crs"
CRS84 = f"{_OGC}/OGC/1.3/CRS84"


@dataclass(frozen=True, slots=True)
class NamedCrs:
    """A CRS that features can be requested in.

    Attributes
    ----------
    uri : str
    crs : pyproj.CRS
    lat_first : bool
        Whether its first axis is latitude.
    """

    uri: str
    crs: Any
    lat_first: bool = False


class CrsList:
    """CRSs that features of a body can be requested in, the default first.

    Parameters
    ----------
    body : Body
    base : str
        URL below which the server defines its own CRSs.
    """

    def __init__(self, body: Body, base: str) -> None:
        self.body = body
        self.all = tuple(_named(body, base))
        self.default = self.all[0]
        self.storage = self.all[1] if len(self.all) > 1 else self.all[0]

    @property
    def uris(self) -> list[str]:
        """URIs of all CRSs."""
        return [named.uri for named in self.all]

    def by_uri(self, uri: str | None, name: str = "crs") -> NamedCrs:
        """Return the CRS with a URI, the default for None; an InputError for others lists the known ones."""
        if uri is None:
            return self.default
        for named in self.all:
            if named.uri == uri.strip("<>[]"):
                return named
        raise InputError(f"{name}={uri[:120]!r}: expected one of {', '.join(self.uris)}")

    def from_degrees(self, named: NamedCrs) -> _Convert:
        """Return the function from longitudes and latitudes to coordinates in the order of the CRS."""
        return _Convert(self.default.crs, named)

    def bounds_to_degrees(self, bounds: list[float], named: NamedCrs) -> list[float]:
        """Return a box ``[first_min, second_min, first_max, second_max]`` of a CRS in degrees, longitude
        first.
        """
        if named is self.default:
            return bounds
        box = bounds if len(bounds) == 4 else [*bounds[:2], *bounds[3:5]]
        if len(box) != 4:
            raise InputError(f"bbox {bounds}: expected 4 or 6 numbers")
        if named.lat_first:
            box = [box[1], box[0], box[3], box[2]]
        if named.crs.is_geographic:
            return box
        transformer = _transformer(named.crs.to_wkt(), self.default.crs.to_wkt())
        degrees = transformer.transform_bounds(box[0], box[1], box[2], box[3], densify_pts=21)
        if not np.all(np.isfinite(degrees)):
            raise InputError(f"bbox {bounds}: lies outside {named.uri}")
        return [float(v) for v in degrees]


class _Convert:
    def __init__(self, degrees: pyproj.CRS, named: NamedCrs) -> None:
        self._named = named
        self._transformer = (
            None if named.crs.is_geographic else _transformer(degrees.to_wkt(), named.crs.to_wkt())
        )

    def __call__(self, lon_lat: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._transformer is not None:
            return np.column_stack(self._transformer.transform(lon_lat[:, 0], lon_lat[:, 1]))
        return lon_lat[:, ::-1] if self._named.lat_first else lon_lat


@functools.lru_cache(maxsize=16)
def _transformer(source_wkt: str, target_wkt: str) -> pyproj.Transformer:
    return pyproj.Transformer.from_crs(source_wkt, target_wkt, always_xy=True)


def _named(body: Body, base: str) -> Iterator[NamedCrs]:
    """Yield the CRS with longitude first; then those of an authority: geographic with its axis order, and
    equirectangular in metres.
    """
    code = code_of(body)
    if code == "EPSG:4326":
        yield NamedCrs(CRS84, pyproj.CRS.from_user_input("OGC:CRS84"))
        yield NamedCrs(f"{_OGC}/EPSG/0/4326", body.geographic_crs, lat_first=True)
        return
    yield NamedCrs(f"{base}/crs/{body.name}_lonlat", lonlat(body))
    if code is not None and code.startswith("IAU_2015:"):
        number = int(code.partition(":")[2])
        lat_first = body.geographic_crs.axis_info[0].direction == "north"
        yield NamedCrs(f"{_OGC}/IAU/2015/{number}", body.geographic_crs, lat_first)
        yield NamedCrs(f"{_OGC}/IAU/2015/{number + 10}", pyproj.CRS.from_authority("IAU_2015", number + 10))


def lonlat(body: Body) -> pyproj.CRS:
    """Return the geographic CRS of a body with longitude as its first axis."""
    definition = body.geographic_crs.to_json_dict()
    axes = definition["coordinate_system"]["axis"]
    axes.sort(key=lambda axis: axis["direction"] != "east")
    definition.pop("id", None)
    return pyproj.CRS.from_json_dict(definition | {"name": f"{definition['name']} (longitude, latitude)"})


@functools.lru_cache(maxsize=64)
def code_of(body: Body) -> str | None:
    """Return the code of the CRS of a body, e.g. ``IAU_2015:49900``; None if no authority defines it."""
    authority = body.geographic_crs.to_authority(min_confidence=90)
    return None if authority is None else ":".join(authority)
