# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scale of keypoints, and selection of the most salient ones."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry.kdtree import kd_tree, spacing
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_3d._kernels import greatest_around
from cdff_core.dfns.features_extraction_3d.interface import Outputs


class ScaleConfig(DfnConfig):
    """Parameters of all keypoint detectors."""

    radius_m: float | None = Field(None, gt=0, description="Edge or radius; absent: from radius_spacings")
    radius_spacings: float = Field(4.0, ge=1, le=200, description="Edge or radius in median point spacings")
    max_keypoints: int = Field(
        2000, ge=1, le=100_000, description="Maximum number of keypoints, evenly picked or most salient"
    )


class SalienceConfig(ScaleConfig):
    """Parameters of the detectors that compare the salience of points."""

    radius_spacings: float = Field(6.0, ge=1, le=200, description="Radius in median point spacings")
    suppression: float = Field(0.67, gt=0, le=10, description="Radius of non-maximum suppression, in radii")


def scale_m(points: FloatArray, given: float | None, cfg: ScaleConfig) -> float:
    """Return the edge or radius in metres: given, configured, or from the spacing of the points."""
    radius_m = cfg.radius_m or cfg.radius_spacings * spacing(kd_tree(points)) if given is None else given
    if not (np.isfinite(radius_m) and radius_m > 0.0):
        raise InputError(f"radius_m={radius_m}: expected metres above 0")
    return radius_m


def most_salient(
    points: FloatArray, salience: FloatArray, least: float, radius_m: float, cfg: SalienceConfig
) -> Outputs:
    """Return the points of salience above ``least`` that are the most salient of their neighbours."""
    candidates = np.flatnonzero(salience > least)
    start, index = radius_neighbours(points, points[candidates], cfg.suppression * radius_m)
    chosen = candidates[greatest_around(salience, candidates, start, index)]
    if len(chosen) > cfg.max_keypoints:
        chosen = chosen[np.argsort(-salience[chosen], kind="stable")[: cfg.max_keypoints]]
    indices = np.sort(chosen)
    return Outputs(keypoints=points[indices], indices=indices)
