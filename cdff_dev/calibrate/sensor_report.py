# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Result of a calibration of two sensors: in words, and as plain data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cdff_common.geometry.rotation_forms import rpy_deg_from_matrix
from cdff_core.calibration.estimate import DIRECTIONS
from cdff_core.calibration.relative_pose import RelativePose


def sensor_lines(result: RelativePose, parent: str, child: str) -> Iterator[str]:
    """Yield the result in words."""
    yield f"{child} in {parent}, from {result.used} views ({result.dropped} dropped):"
    values = [*result.transform.matrix[:3, 3], *rpy_deg_from_matrix(result.transform.matrix[:3, :3])]
    sigmas = [*result.sigma[:3], *np.rad2deg(result.sigma[3:])]
    for name, value, sigma in zip(DIRECTIONS, values, sigmas, strict=True):
        unit, digits = ("m", 4) if name in "xyz" else ("°", 3)
        yield f"  {name:5} {value:10.{digits}f} ± {sigma:.{digits}f} {unit}"
    for name, value in result.figures.items():
        yield f"  {name}: {value:.4g}"
    yield f"assessment: {'; '.join(result.sentences)}"


def sensor_document(result: RelativePose, parent: str, child: str) -> dict[str, Any]:
    """Return the pose, its covariance, the residuals and the assessment as plain data."""
    covariance = result.transform.covariance
    assert covariance is not None
    return {
        "parent": parent,
        "child": child,
        "T": result.transform.matrix.tolist(),
        "covariance": covariance.tolist(),
        "undetermined": list(result.undetermined),
        "used": result.used,
        "dropped": result.dropped,
        "figures": dict(result.figures),
        "assessment": list(result.sentences),
    }
