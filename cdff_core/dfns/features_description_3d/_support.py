# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What every descriptor begins with: checked inputs, and the radius of the support."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_description_3d._interface import FeaturesDescription3DInputs

Float = NDArray[np.float64]


class SupportConfig(DfnConfig):
    """Size of the support."""

    radius_m: float | None = Field(None, gt=0.0, description="Radius of the support, metres; absent: radius_spacings")
    radius_spacings: float = Field(12.0, ge=2.0, le=200.0, description="Radius in median point spacings")
    least_neighbours: int = Field(10, ge=5, le=10_000, description="Fewest points of a support that is described")


def checked_support(inputs: FeaturesDescription3DInputs, cfg: SupportConfig) -> tuple[Float, Float, Float, float]:
    """Return points, normals, keypoints and radius in metres; raises InputError where they do not fit."""
    from cdff_common.geometry.kdtree import kd_tree, spacing

    points = checked_points(inputs.points, least=2)
    normals = checked_points(inputs.normals, "normals", len(points))
    if len(normals) != len(points):
        raise InputError(f"normals: {len(normals)} rows for {len(points)} points")
    keypoints = checked_points(inputs.keypoints, "keypoints")
    if inputs.radius_m is not None:
        radius_m = float(inputs.radius_m)
    else:
        radius_m = cfg.radius_m or cfg.radius_spacings * spacing(kd_tree(points))
    if not (np.isfinite(radius_m) and radius_m > 0.0):
        raise InputError(f"radius_m={radius_m}: expected metres above 0")
    return points, normals, keypoints, radius_m
