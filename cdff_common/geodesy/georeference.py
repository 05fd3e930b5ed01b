# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Coordinate reference system for files and services, and the frame's axes in it.

The plane of an anchored frame is the orthographic projection of its body about the frame's origin
(EPSG:9840), which PROJ supports since 7.2. A rotation or height of the frame is part of the transform from
its x and y to easting and northing: "Local Orthographic" (EPSG:1130), which would contain both, exists since
PROJ 9.5 only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Georeference:
    """CRS of a file, and the transform of frame coordinates to it.

    Attributes
    ----------
    wkt : str
        WKT2 of the CRS.
    rows : tuple of two tuples
        ``a b c`` of easting and of northing: ``easting = a x + b y + c``, metres.
    """

    wkt: str
    rows: tuple[tuple[float, float, float], tuple[float, float, float]] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

    @property
    def crs(self) -> Any:
        """``pyproj.CRS`` of ``wkt``."""
        import pyproj

        return pyproj.CRS.from_wkt(self.wkt)

    @property
    def is_identity(self) -> bool:
        """True if the frame's x and y are easting and northing."""
        return self.rows == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

    def to_dict(self) -> dict[str, Any]:
        """Return the dict form for MessagePack and JSON."""
        return {"wkt": self.wkt, "rows": [list(row) for row in self.rows]}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Georeference:
        """Return the georeference of a dict form."""
        easting, northing = ((float(a), float(b), float(c)) for a, b, c in data["rows"])
        return cls(str(data["wkt"]), (easting, northing))

    def coordinates(self, points_m: ArrayLike) -> FloatArray:
        """Return easting and northing of points ``(n, 2)`` or ``(n, 3)`` in the frame, with z unchanged."""
        points = np.atleast_2d(np.asarray(points_m, dtype=np.float64))
        matrix = np.array(self.rows)
        plane = points[:, :2] @ matrix[:, :2].T + matrix[:, 2]
        return np.column_stack([plane, points[:, 2:]])
