# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where a frame is: anchored on a body, fixed to one without a surface, or nowhere but in itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geodesy.anchor import Anchor, FloatArray
from cdff_common.geodesy.bodies import Body, engineering_projjson


@dataclass(frozen=True, slots=True)
class Place:
    """Where a frame is.

    Attributes
    ----------
    frame : str
    body : Body or None
        The body that fixed edges join it with.
    anchor : Anchor or None
        Where on the body; None for a body without longitude and latitude, or for its own frame.
    frames_revision : int
        State of the frame tree that this holds in.
    """

    frame: str
    body: Body | None = None
    anchor: Anchor | None = None
    frames_revision: int = 0

    @property
    def crs(self) -> Any:
        """``pyproj.CRS`` of the frame's x and y: of the body where it is anchored, else engineering, named after it."""
        if self.anchor is not None:
            return self.anchor.crs
        if self.body is not None and self.body.name == self.frame:
            return self.body.fixed_crs
        import pyproj

        return pyproj.CRS.from_json_dict(engineering_projjson(self.frame))

    @property
    def wkt(self) -> str:
        """WKT2 of ``crs``."""
        return str(self.crs.to_wkt("WKT2_2019"))

    def lonlat(self, points_m: ArrayLike) -> FloatArray:
        """See ``Anchor.lonlat``; raises InputError where the frame is not anchored."""
        return self._anchored().lonlat(points_m)

    def points(self, lonlat: ArrayLike) -> FloatArray:
        """See ``Anchor.points``; raises InputError where the frame is not anchored."""
        return self._anchored().points(lonlat)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for MessagePack and JSON."""
        return {
            "frame": self.frame, "body": None if self.body is None else self.body.to_dict(),
            "anchor": None if self.anchor is None else self.anchor.to_dict(), "wkt": self.wkt,
            "frames_revision": self.frames_revision,
        }  # fmt: skip

    def _anchored(self) -> Anchor:
        if self.anchor is None:
            raise InputError(f"frame {self.frame} is not anchored on a body: it has no longitude and latitude")
        return self.anchor
