# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Celestial bodies and the location of frames on them: coordinate reference systems, longitude and
latitude.
"""

from cdff_common.geodesy.anchor import Anchor
from cdff_common.geodesy.bodies import Body, body, body_names, crs_of
from cdff_common.geodesy.frame_location import FrameLocation
from cdff_common.geodesy.georeference import Georeference

__all__ = ["Anchor", "Body", "FrameLocation", "Georeference", "body", "body_names", "crs_of"]
