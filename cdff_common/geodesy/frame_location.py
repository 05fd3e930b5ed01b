# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Location of a frame: anchored on a body, fixed to a body without a surface, or unknown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geodesy.anchor import Anchor, FloatArray
from cdff_common.geodesy.bodies import Body, engineering_projjson
from cdff_common.geodesy.georeference import Georeference


@dataclass(frozen=True, slots=True)
class FrameLocation:
    """Location of a frame.

    Attributes
    ----------
    frame : str
    body : Body or None
        Body that is connected to it by fixed edges.
    anchor : Anchor or None
        Location on the body; None for a body without longitude and latitude, or for the body frame.
    frames_revision : int
        Revision of the frame tree.
    """

    frame: str
    body: Body | None = None
    anchor: Anchor | None = None
    frames_revision: int = 0

    @property
    def crs(self) -> Any:
        """``pyproj.CRS`` of x and y: that of the body for an anchored frame, else an engineering CRS named
        after it.
        """
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

    @property
    def georeference(self) -> Georeference:
        """CRS for files and the frame's axes in it; see ``Anchor.georeference``."""
        return Georeference(self.wkt) if self.anchor is None else self.anchor.georeference

    def lonlat(self, points_m: ArrayLike) -> FloatArray:
        """Return ``Anchor.lonlat``; raises InputError if the frame is not anchored."""
        return self._required_anchor().lonlat(points_m)

    def points(self, lonlat: ArrayLike) -> FloatArray:
        """Return ``Anchor.points``; raises InputError if the frame is not anchored."""
        return self._required_anchor().points(lonlat)

    def to_dict(self) -> dict[str, Any]:
        """Return the dict form for MessagePack and JSON."""
        return {
            "frame": self.frame,
            "body": None if self.body is None else self.body.to_dict(),
            "anchor": None if self.anchor is None else self.anchor.to_dict(),
            "wkt": self.wkt,
            "georeference": self.georeference.to_dict(),
            "frames_revision": self.frames_revision,
        }

    def _required_anchor(self) -> Anchor:
        if self.anchor is None:
            raise InputError(
                f"frame {self.frame} is not anchored on a body: it has no longitude and latitude"
            )
        return self.anchor
