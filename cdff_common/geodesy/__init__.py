# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies and where on them a frame lies: coordinate reference systems, longitude and latitude."""

from cdff_common.geodesy.anchor import Anchor
from cdff_common.geodesy.bodies import Body, body, body_names, crs_of
from cdff_common.geodesy.place import Place

__all__ = ["Anchor", "Body", "Place", "body", "body_names", "crs_of"]
