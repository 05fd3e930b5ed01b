# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The scale at which keypoints are looked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig


class ScaleConfig(DfnConfig):
    """Scale of the keypoints and how many there may be."""

    radius_m: float | None = Field(None, gt=0.0, description="Edge or radius, metres; absent: radius_spacings")
    radius_spacings: float = Field(4.0, ge=1.0, le=200.0, description="Edge or radius in median point spacings")
    max_keypoints: int = Field(2000, ge=1, le=100_000, description="Keypoints at most")


def scale_m(points: NDArray[np.float64], given: NDArray[np.float64] | None, cfg: ScaleConfig) -> float:
    """Edge or radius in metres: as given, as configured, or from the spacing of the points."""
    from cdff_common.geometry.kdtree import kd_tree, spacing

    if given is not None:
        radius_m = float(given)
    else:
        radius_m = cfg.radius_m or cfg.radius_spacings * spacing(kd_tree(points))
    if not (np.isfinite(radius_m) and radius_m > 0.0):
        raise InputError(f"radius_m={radius_m}: expected metres above 0")
    return radius_m
