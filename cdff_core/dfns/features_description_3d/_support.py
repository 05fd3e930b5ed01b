# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the descriptors: checks of the inputs, and the radius of the support (neighbourhood)."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry.kdtree import kd_tree, spacing
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_description_3d.interface import Inputs


class SupportConfig(DfnConfig):
    """Parameters of all descriptors."""

    radius_m: float | None = Field(
        None,
        gt=0,
        description="Radius of the support; absent: radius_spacings times the median point spacing",
    )
    radius_spacings: float = Field(
        12.0, ge=2, le=200, description="Radius of the support in median point spacings"
    )
    least_neighbours: int = Field(10, ge=5, le=10_000, description="Minimum number of points of a support")


def checked_support(inputs: Inputs, cfg: SupportConfig) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return points, normals and keypoints as checked arrays (N, 3), and the radius of the support in metres.

    The radius is the first that is given: the input, ``radius_m``, or ``radius_spacings`` times the median
    point spacing. Raises InputError for an array of another shape, values that are not finite or a radius
    ≤ 0.
    """
    points = checked_points(inputs.points, least=2)
    normals = checked_points(inputs.normals, "normals")
    keypoints = checked_points(inputs.keypoints, "keypoints")
    if inputs.radius_m is not None:
        radius_m = inputs.radius_m
    else:
        radius_m = cfg.radius_m or cfg.radius_spacings * spacing(kd_tree(points))
    if not (np.isfinite(radius_m) and radius_m > 0.0):
        raise InputError(f"radius_m={radius_m}: expected metres above 0")
    return points, normals, keypoints, radius_m
