# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the detectors: their scale, and the selection of the most salient points."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry.kdtree import kd_tree, spacing
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_3d._kernels import are_local_maxima
from cdff_core.dfns.features_extraction_3d.interface import Outputs


class ScaleConfig(DfnConfig):
    """Parameters of all keypoint detectors."""

    radius_m: float | None = Field(
        None,
        gt=0,
        description="Edge of the cells or radius of the neighbourhoods; absent: from radius_spacings",
    )
    radius_spacings: float = Field(4.0, ge=1, le=200, description="Edge or radius in median point spacings")
    max_keypoints: int = Field(
        2000,
        ge=1,
        le=100_000,
        description="Maximum number of keypoints; of more, evenly spaced or the most salient ones are kept",
    )


class SalienceConfig(ScaleConfig):
    """Parameters of the detectors that compare the salience of points."""

    radius_spacings: float = Field(6.0, ge=1, le=200, description="Radius in median point spacings")
    suppression: float = Field(
        0.67,
        gt=0,
        le=10,
        description="Radius of non-maximum suppression relative to that of the neighbourhoods",
    )


def scale_m(points: FloatArray, stated_m: float | None, cfg: ScaleConfig) -> float:
    """Return the edge or radius in metres: the given or configured one, or from the spacing of the points."""
    radius_m = (
        cfg.radius_m or cfg.radius_spacings * spacing(kd_tree(points)) if stated_m is None else stated_m
    )
    if not (np.isfinite(radius_m) and radius_m > 0.0):
        raise InputError(f"radius_m={radius_m}: expected metres above 0")
    return radius_m


def select_most_salient(
    points: FloatArray, salience: FloatArray, threshold: float, radius_m: float, cfg: SalienceConfig
) -> Outputs:
    """Return the points with a salience above ``threshold`` that are the most salient of their neighbours."""
    candidates = np.flatnonzero(salience > threshold)
    start, index = radius_neighbours(points, points[candidates], cfg.suppression * radius_m)
    selected = candidates[are_local_maxima(salience, candidates, start, index)]
    if len(selected) > cfg.max_keypoints:
        selected = selected[np.argsort(-salience[selected], kind="stable")[: cfg.max_keypoints]]
    indices = np.sort(selected)
    return Outputs(keypoints=points[indices], indices=indices)
