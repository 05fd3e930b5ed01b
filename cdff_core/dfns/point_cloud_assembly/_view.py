# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checked clouds, cut to the view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_core.dfns.point_cloud_assembly._interface import PointCloudAssemblyInputs

Float = NDArray[np.float64]


def in_view(inputs: PointCloudAssemblyInputs) -> tuple[Float, Float]:
    """Both clouds within the view; raises InputError where they are malformed or nothing is left."""
    first = checked_points(inputs.first_points, "first_points", 0)
    second = checked_points(inputs.second_points, "second_points", 0)
    if inputs.view_radius_m is not None:
        centre = np.zeros(3) if inputs.view_centre_m is None else np.asarray(inputs.view_centre_m, dtype=np.float64)
        radius_m = float(inputs.view_radius_m)
        if centre.shape != (3,) or not np.all(np.isfinite(centre)) or not radius_m > 0.0:
            raise InputError(f"view: centre {centre.tolist()}, radius {radius_m} m: expected 3 metres, and more than 0")
        first, second = (p[np.einsum("ij,ij->i", p - centre, p - centre) <= radius_m**2] for p in (first, second))
    if not len(first) + len(second):
        raise InputError("no point of either cloud lies within the view")
    return first, second
