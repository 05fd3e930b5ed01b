# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction of a state by offsets that were measured in an image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.measured_pose_refinement.interface import (
    MeasuredPoseRefinementInputs,
    MeasuredPoseRefinementOutputs,
)
from cdff_core.dfns.model_edge_measurement.interface import ModelEdgeMeasurementOutputs
from cdff_core.dfns.model_region_measurement.interface import ModelRegionMeasurementOutputs
from cdff_core.object_models.tracked_state import TrackedState


@dataclass(frozen=True, slots=True, eq=False)
class PointOffsets:
    """Offsets of tracked points along both axes of the image, two rows for each point.

    Attributes
    ----------
    points : ndarray, shape (2n, 3)
        In the frame of the model, metres.
    pixels : ndarray, shape (2n, 2)
        Column and row from which the points were tracked.
    normals : ndarray, shape (2n, 2)
        Directions of the offsets.
    offsets : ndarray, shape (2n, 1)
        In px.
    """

    points: FloatArray
    pixels: FloatArray
    normals: FloatArray
    offsets: FloatArray

    @classmethod
    def of_matches(cls, points_m: FloatArray, pixels: FloatArray, matches: FloatArray) -> PointOffsets:
        """Return the offsets of points (n, 3) that were tracked from pixels to matches, both (n, 2)."""
        return cls(
            np.repeat(points_m, 2, axis=0),
            np.repeat(pixels, 2, axis=0),
            np.tile(np.eye(2), (len(pixels), 1)),
            (matches - pixels).reshape(-1, 1),
        )


def require_count(count: int, minimum: int, description: str, reason: str) -> None:
    """Raise RefusedError with the reason ``reason:count<minimum`` if there are fewer than ``minimum``."""
    if count < minimum:
        raise RefusedError(description, [f"{reason}:{count}<{minimum}"])


def corrected_state(
    refine: Dfn[Any, Any, Any],
    state: TrackedState,
    predicted: TrackedState,
    offsets: PointOffsets | ModelEdgeMeasurementOutputs | ModelRegionMeasurementOutputs,
    camera_matrix: FloatArray,
    limit_px: float,
) -> tuple[TrackedState, MeasuredPoseRefinementOutputs]:
    """Return the state corrected by offsets that were measured at it, and the outputs of the refinement.

    Parameters
    ----------
    refine : Dfn
        MeasuredPoseRefinement.
    predicted : TrackedState
        Prior of the correction.
    camera_matrix : ndarray, shape (3, 3)
    limit_px : float
        Residual above which a point has no weight in the first step.
    """
    outputs: MeasuredPoseRefinementOutputs = refine.process(
        MeasuredPoseRefinementInputs(
            points=offsets.points,
            pixels=offsets.pixels,
            normals=offsets.normals,
            offsets=offsets.offsets,
            sigmas=offsets.sigmas if isinstance(offsets, ModelRegionMeasurementOutputs) else None,
            camera_matrix=camera_matrix,
            pose=state.T,
            limit_px=limit_px,
            prior_covariance=predicted.covariance,
            prior_error=predicted.difference(state),
        )
    )
    return state.corrected(outputs.correction, outputs.covariance), outputs
