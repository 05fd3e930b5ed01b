# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction of a predicted state by the edges of an image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.model_edge_measurement.interface import ModelEdgeMeasurementInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.object_models.measured_correction import corrected_state, require_count
from cdff_core.object_models.tracked_state import TrackedState

#: Smallest range of the search for edges, px, and number of standard deviations of the prediction that the
#: range covers.
_MIN_RANGE_PX, _SIGMAS = 4.0, 3.0


@dataclass(frozen=True, slots=True, eq=False)
class ImageFit:
    """A corrected state and how well the image agrees with it.

    Attributes
    ----------
    state : TrackedState
    distance : float
        Squared Mahalanobis distance of the correction from the prediction.
    agreement : float
        Fraction of the edge points that agree with the image.
    sigma_px : float
        Robust standard deviation of their offsets.
    points : int
        Edge points in the image.
    range_px : float
        Range of the first search.
    """

    state: TrackedState
    distance: float
    agreement: float
    sigma_px: float
    points: int
    range_px: float


class ImageFitter:
    """Fit of a state to the edges of images.

    Parameters
    ----------
    edges, refine : Dfn
        ModelEdgeMeasurement and MeasuredPoseRefinement.
    rounds : int
        Measurements of the edges of an image.
    max_range_px : float
    min_points : int
        Edge points below which an image is refused.
    """

    def __init__(
        self,
        edges: Dfn[Any, Any, Any],
        refine: Dfn[Any, Any, Any],
        rounds: int,
        max_range_px: float,
        min_points: int,
    ) -> None:
        self._edges, self._refine = edges, refine
        self._rounds, self._max_range_px, self._min_points = rounds, max_range_px, min_points

    def fit(
        self,
        model: ModelPreparationOutputs,
        predicted: TrackedState,
        image: Float32Array,
        camera_matrix: FloatArray,
    ) -> ImageFit:
        """Return the state corrected by the edges of a grey image.

        Parameters
        ----------
        model : ModelPreparationOutputs
            Mesh of the body, metres.
        predicted : TrackedState
            State in the frame of the camera (x right, y down, z forward) at the time of the image.
        image : ndarray of float32, shape (r, c)
            Grey levels, without lens distortion.
        camera_matrix : ndarray, shape (3, 3)
            Pixels; (0, 0) is the centre of the first pixel.

        Raises
        ------
        RefusedError
            ``few_edges:n<m`` or ``behind_camera``.
        """
        first_px = range_px = search_range_px(
            model, predicted.T, predicted.covariance[:6, :6], camera_matrix, self._max_range_px
        )
        state = predicted
        for _ in range(self._rounds):
            edge_offsets = self._edges.process(
                ModelEdgeMeasurementInputs(
                    image=image,
                    camera_matrix=camera_matrix,
                    pose=state.T,
                    vertices=model.drawn_vertices,
                    triangles=model.drawn_triangles,
                    range_px=range_px,
                )
            )
            count = len(edge_offsets.points)
            require_count(count, self._min_points, f"{count} edge points in the image", "few_edges")
            state, outputs = corrected_state(
                self._refine, state, predicted, edge_offsets, camera_matrix, range_px
            )
            range_px = max(0.5 * range_px, _MIN_RANGE_PX)
        distance = state.squared_distance(predicted)
        return ImageFit(
            state, distance, outputs.agreement, outputs.sigma_px, len(edge_offsets.points), first_px
        )


def search_range_px(
    model: ModelPreparationOutputs,
    T_camera_body: FloatArray,
    covariance: FloatArray,
    camera_matrix: FloatArray,
    largest_px: float,
) -> float:
    """Return the range of a search in the image that covers the uncertainty of a pose, px.

    Parameters
    ----------
    model : ModelPreparationOutputs
        Mesh of the body, of which the centre and the diameter are used, metres.
    T_camera_body : ndarray, shape (4, 4)
    covariance : ndarray, shape (6, 6)
        Of the position (m2) and of the rotation (rad2) in the axes of the camera, in this order.
    camera_matrix : ndarray, shape (3, 3)
        Pixels.
    largest_px : float
        Limit of the range.

    Raises
    ------
    RefusedError
        ``behind_camera``.
    """
    depth_m = float(T_camera_body[2, :3] @ model.centre_m + T_camera_body[2, 3])
    if depth_m <= 0.0:
        raise RefusedError("the body is behind the camera", ["behind_camera"])
    variances = np.diag(covariance)
    across_m = math.sqrt(max(float(variances[:2].max()), 0.0))
    rotation_m = 0.5 * model.diameter_m * math.sqrt(max(float(variances[3:6].max()), 0.0))
    sigma_px = float(camera_matrix[0, 0]) * (across_m + rotation_m) / depth_m
    return min(max(_SIGMAS * sigma_px, _MIN_RANGE_PX), largest_px)
