# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Coverages of elevation in degrees (OGC API Coverages, draft 19-087, as the driver OGCAPI of GDAL uses it).

The cells of a coverage are rectangles of longitude and latitude. The value of a cell is that of the cell of
the elevation window at its centre.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.formats.geotiff import DEM_BANDS
from cdff_common.geodesy import FrameLocation
from dpm_store.search.extents import Extent
from services.dpm.http.context import Context
from services.dpm.http.models import Json
from services.dpm.http.stac.catalogue import bounds_deg, numbers_of

#: Axes of a coverage, and its largest number of cells.
AXES = ("Lon", "Lat")
_MAX_CELLS = 1 << 20
_NUMBER = r"[-+]?[0-9.]{1,40}(?:[eE][-+]?[0-9]{1,3})?"
_SUBSET = re.compile(rf"(Lon|Lat)\(({_NUMBER}):({_NUMBER})\)")
_SIZE = re.compile(r"(Lon|Lat)\(([0-9]{1,7})\)")


@dataclass(frozen=True, slots=True)
class DegreeGrid:
    """Cells of equal size in degrees, row 0 in the north.

    Attributes
    ----------
    bounds_deg : tuple of 4 float
        West, south, east and north edge, degrees.
    shape : tuple of 2 int
        Rows and columns.
    """

    bounds_deg: tuple[float, float, float, float]
    shape: tuple[int, int]

    @classmethod
    def parse(cls, bbox: str | None, subset: str | None, size: str) -> DegreeGrid:
        """Return the grid of ``bbox=`` or ``subset=Lon(a:b),Lat(a:b)``, and ``scaleSize=Lon(n),Lat(n)``.

        Raises InputError.
        """
        if bbox is not None and subset is not None:
            raise InputError(f"subset={subset[:80]!r}: not together with bbox")
        sides = {axis: int(n) for axis, n in _all(_SIZE, size, "scaleSize")}
        if subset is not None:
            limits = {axis: f"{lower},{upper}" for axis, lower, upper in _all(_SUBSET, subset, "subset")}
            try:
                west, east, south, north = map(float, f"{limits['Lon']},{limits['Lat']}".split(","))
            except ValueError as error:
                raise InputError(f"subset={subset[:80]!r}: expected numbers, degrees") from error
        else:
            numbers = numbers_of(bbox or "") or []
            if len(numbers) != 4:
                raise InputError(f"bbox={(bbox or '')[:80]!r}: expected 4 numbers, or subset=")
            west, south, east, north = numbers
        if not (-360.0 <= west < east <= 360.0 and -90.0 <= south < north <= 90.0):
            name, text = ("bbox", bbox) if subset is None else ("subset", subset)
            raise InputError(f"{name}={(text or '')[:80]!r}: expected west < east and south < north, degrees")
        if not 0 < sides["Lon"] * sides["Lat"] <= _MAX_CELLS:
            raise InputError(f"scaleSize={size[:80]!r}: expected 1 to {_MAX_CELLS} cells")
        return cls((west, south, east, north), (sides["Lat"], sides["Lon"]))

    @property
    def cell_deg(self) -> tuple[float, float]:
        """Width and height of a cell, degrees."""
        west, south, east, north = self.bounds_deg
        return (east - west) / self.shape[1], (north - south) / self.shape[0]

    def centres(self) -> NDArray[np.float64]:
        """Return longitude and latitude of the centre of each cell, ``(rows * cols, 2)``, degrees."""
        west, _, _, north = self.bounds_deg
        (width, height), (rows, cols) = self.cell_deg, self.shape
        lon = west + (np.arange(cols) + 0.5) * width
        lat = north - (np.arange(rows) + 0.5) * height
        return np.column_stack([np.tile(lon, rows), np.repeat(lat, cols)])


def _all(form: re.Pattern[str], text: str, name: str) -> list[tuple[Any, ...]]:
    """Return axis and values of each axis in a text such as ``Lon(7:8),Lat(1:2)``; raises InputError."""
    parts = [part.fullmatch(item) for part, item in ((form, item) for item in text.split(","))]
    found = [part.groups() for part in parts if part is not None]
    if len(parts) != 2 or {part[0] for part in found} != set(AXES):
        raise InputError(f"{name}={text[:80]!r}: expected both axes, as in Lon(…),Lat(…)")
    return found


def domain_set(context: Context, frame: str, crs: str) -> Json:
    """Return the extent and the resolution of the elevation in a frame, degrees."""
    extent, location = elevation_extent(context, frame)
    assert extent.box_m is not None  # checked with the extent
    outline = shapely.box(*extent.box_m[:2], *extent.box_m[3:5])
    bounds = bounds_deg([context.places.outline_in_degrees(frame, outline)])
    if bounds is None:
        raise ProductNotFoundError(f"frame {frame[:80]} has no elevation on a body")
    step = resolution_deg(location, extent.resolution_m or 1.0)
    axes = [
        {
            "type": "RegularAxis",
            "axisLabel": axis,
            "lowerBound": bounds[i],
            "upperBound": bounds[i + 2],
            "resolution": step,
            "uomLabel": "deg",
        }
        for i, axis in enumerate(AXES)
    ]
    grid = {"type": "GeneralGridCoverage", "srsName": crs, "axisLabels": list(AXES), "axis": axes}
    return {"type": "DomainSet", "generalGrid": grid}


def range_type() -> Json:
    """Return the bands of the coverages."""
    fields = [{"type": "Quantity", "name": name, "definition": "FLOAT32"} for name in DEM_BANDS]
    return {"type": "DataRecord", "field": fields}


def resolution_deg(location: FrameLocation, cell_m: float) -> float:
    """Return the latitude that a length spans at the origin of an anchored frame, degrees."""
    south, north = location.lonlat(np.array([[0.0, 0.0], [0.0, 1.0]]))[:, :2]
    east = location.lonlat(np.array([[1.0, 0.0]]))[0, :2]
    per_m = math.hypot(north[1] - south[1], east[1] - south[1])
    return float(cell_m * per_m)


def elevation_extent(context: Context, frame: str) -> tuple[Extent, FrameLocation]:
    """Return the stored extent of elevation in an anchored frame; raises ProductNotFoundError."""
    location = context.places.of(frame)
    extents = [e for e in context.extents.get(context.dpm.store) if (e.product, e.frame) == ("dem", frame)]
    if location.anchor is None or not extents or extents[0].box_m is None:
        raise ProductNotFoundError(f"frame {frame[:80]} has no elevation on a body")
    return extents[0], location


def sampled(
    layers: Mapping[str, NDArray[Any]], xy_m: NDArray[np.float64], geometry: Any, shape: tuple[int, int]
) -> dict[str, NDArray[np.float32]]:
    """Return the bands at points ``(n, 2)`` of the frame, NaN outside the window."""
    col = np.floor((xy_m[:, 0] - geometry.xmin_m) / geometry.resolution_m)
    row = np.floor((geometry.ymax_m - xy_m[:, 1]) / geometry.resolution_m)
    is_inside = (col >= 0) & (row >= 0) & (col < geometry.cols) & (row < geometry.rows)
    at = row[is_inside].astype(np.int64), col[is_inside].astype(np.int64)
    bands = {}
    for name in DEM_BANDS:
        values = np.full(len(xy_m), np.nan, dtype=np.float32)
        if name in layers:
            values[is_inside] = layers[name][at]
        bands[name] = values.reshape(shape)
    return bands
