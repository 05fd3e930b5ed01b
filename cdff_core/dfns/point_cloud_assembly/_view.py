# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Validation of both clouds, and cropping to the view."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_core.dfns.point_cloud_assembly.interface import Inputs


def crop_to_view(inputs: Inputs) -> tuple[FloatArray, FloatArray]:
    """Return the points of both clouds within the view; raises InputError if one is malformed or no point
    remains.
    """
    first = checked_points(inputs.first_points, "first_points", 0)
    second = checked_points(inputs.second_points, "second_points", 0)
    if inputs.view_radius_m is not None:
        centre = np.zeros(3) if inputs.view_centre_m is None else np.asarray(inputs.view_centre_m, np.float64)
        limit = inputs.view_radius_m**2
        first, second = (p[np.einsum("ij,ij->i", p - centre, p - centre) <= limit] for p in (first, second))
    if not len(first) + len(second):
        raise InputError("no point of either cloud lies within the view")
    return first, second
