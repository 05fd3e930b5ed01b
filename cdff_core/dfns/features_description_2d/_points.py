# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the descriptors share: inputs with their shapes checked, sizes and angles where the detector gave none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_description_2d._interface import FeaturesDescription2DInputs, FeaturesDescription2DOutputs
from cdff_core.imaging.keypoints import centroid_angles

FloatArray = NDArray[np.float64]


class PointsConfig(DfnConfig):
    """Parameters that every descriptor shares."""

    upright: bool = False


class SiftPointsConfig(PointsConfig):
    """Parameters of the descriptors by gradients."""

    corner_size_px: Annotated[float, Field(ge=2, le=100)] = 6.0


def checked_points(
    inputs: FeaturesDescription2DInputs, size_px: float, upright: bool
) -> tuple[NDArray[np.uint8], FloatArray, FloatArray, FloatArray]:
    """Image, points ``(n, 2)``, sizes and angles ``(n,)``; raises InputError where they do not fit."""
    image, points = np.ascontiguousarray(inputs.image), np.array(inputs.features, np.float64)
    if image.ndim != 2 or image.dtype != np.uint8 or points.ndim != 2 or points.shape[1] != 2:
        raise InputError(f"image {image.shape} {image.dtype}, features {points.shape}: expected grey uint8, (n, 2)")
    n = len(points)
    sizes = np.full(n, size_px) if inputs.sizes is None else np.array(inputs.sizes, np.float64)
    if upright:
        angles = np.zeros(n)
    elif inputs.angles is None:
        angles = centroid_angles(image, points)
    else:
        angles = np.array(inputs.angles, np.float64)
    if sizes.shape != (n,) or angles.shape != (n,):
        raise InputError(f"sizes {sizes.shape}, angles {angles.shape}: expected both ({n},)")
    return image, points, sizes, angles


def outputs_of(described: Sequence[Any], rows: NDArray[Any] | None, n: int, width: int) -> FeaturesDescription2DOutputs:
    """Descriptors in the order of the points; ``class_id`` says which point each is of."""
    descriptors, valid = np.zeros((n, width), np.uint8), np.zeros(n, bool)
    if rows is not None and len(rows):
        index = np.array([p.class_id for p in described], np.int64)
        descriptors[index], valid[index] = rows, True
    return FeaturesDescription2DOutputs(descriptors=descriptors, valid=valid)
