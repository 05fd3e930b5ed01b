# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the descriptors: default sizes and angles, and the order of the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_description_2d.interface import Inputs, Outputs
from cdff_core.imaging.keypoints import centroid_angles


class PointsConfig(DfnConfig):
    """Parameters of all descriptors."""

    upright: bool = Field(
        False, description="Ignore the orientation of the keypoints; for cameras that do not roll"
    )


def arrays_of(
    inputs: Inputs, size_px: float, upright: bool
) -> tuple[ByteArray, FloatArray, FloatArray, FloatArray]:
    """Return image, points ``(n, 2)``, sizes and angles ``(n,)``; absent and NaN ones get default values."""
    image, points = np.ascontiguousarray(inputs.image), np.array(inputs.features, np.float64)
    n = len(points)
    sizes = np.full(n, np.nan) if inputs.sizes is None else np.array(inputs.sizes, np.float64)
    angles = np.full(n, np.nan) if inputs.angles is None else np.array(inputs.angles, np.float64)
    sizes[np.isnan(sizes)] = size_px
    if upright:
        angles[:] = 0.0
    elif (unknown := np.isnan(angles)).any():
        angles[unknown] = centroid_angles(image, points[unknown])
    return image, points, sizes, angles


def outputs_of(
    described_keypoints: Sequence[Any], rows: NDArray[Any] | None, point_count: int, descriptor_bytes: int
) -> Outputs:
    """Return one descriptor per point, 0 and invalid for points that OpenCV dropped.

    ``rows`` holds the descriptors of ``described_keypoints``, whose ``class_id`` is the index of the point.
    """
    descriptors, valid = np.zeros((point_count, descriptor_bytes), np.uint8), np.zeros(point_count, bool)
    if rows is not None and len(rows):
        index = np.array([p.class_id for p in described_keypoints], np.int64)
        descriptors[index], valid[index] = rows, True
    return Outputs(descriptors=descriptors, valid=valid)
