# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the descriptors: sizes and angles for detectors that compute none."""

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
        False, description="Describe points without their orientation, for cameras that do not roll"
    )


def arrays_of(
    inputs: Inputs, size_px: float, upright: bool
) -> tuple[ByteArray, FloatArray, FloatArray, FloatArray]:
    """Return image, points ``(n, 2)``, sizes and angles ``(n,)``."""
    image, points = np.ascontiguousarray(inputs.image), np.array(inputs.features, np.float64)
    n = len(points)
    sizes = np.full(n, size_px) if inputs.sizes is None else np.array(inputs.sizes, np.float64)
    if upright:
        angles = np.zeros(n)
    elif inputs.angles is None:
        angles = centroid_angles(image, points)
    else:
        angles = np.array(inputs.angles, np.float64)
    return image, points, sizes, angles


def outputs_of(described: Sequence[Any], rows: NDArray[Any] | None, n: int, width: int) -> Outputs:
    """Return the descriptors in the order of the points; ``class_id`` is the index of the point."""
    descriptors, valid = np.zeros((n, width), np.uint8), np.zeros(n, bool)
    if rows is not None and len(rows):
        index = np.array([p.class_id for p in described], np.int64)
        descriptors[index], valid[index] = rows, True
    return Outputs(descriptors=descriptors, valid=valid)
