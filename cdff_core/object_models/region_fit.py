# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction of a predicted state by the colours of a body and of its background."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfns.model_region_measurement.interface import ModelRegionMeasurementInputs
from cdff_core.dfns.region_colour_learning.interface import (
    RegionColourLearningInputs,
    RegionColourLearningOutputs,
)
from cdff_core.object_models.image_fit import search_range_px
from cdff_core.object_models.measured_correction import corrected_state, require_count
from cdff_core.object_models.tracked_state import TrackedState

#: Largest number of measurements of an image, and the range of the last one, px.
_ROUNDS, _MIN_RANGE_PX = 3, 6.0
#: Least number of lines.
_MIN_LINES = 20


@dataclass(frozen=True, slots=True, eq=False)
class RegionFit:
    """A corrected state, how well the lines agree with it, and their number.

    Attributes
    ----------
    state : TrackedState
    distance : float
        Squared Mahalanobis distance of the correction from the prediction.
    agreement : float
        Fraction of the lines that agree with it.
    lines : int
    """

    state: TrackedState
    distance: float
    agreement: float
    lines: int


class RegionFitter:
    """Fit of a state to the regions of colour of images; it learns the colours.

    Parameters
    ----------
    regions, refine, learn : Dfn
        ModelRegionMeasurement, MeasuredPoseRefinement and RegionColourLearning.
    max_range_px : float
        Largest offset of the outline from its prediction.
    """

    def __init__(
        self,
        regions: Dfn[Any, Any, Any],
        refine: Dfn[Any, Any, Any],
        learn: Dfn[Any, Any, Any],
        max_range_px: float,
    ) -> None:
        self._regions, self._refine, self._learn = regions, refine, learn
        self._max_range_px = max_range_px
        self.clear()

    def clear(self) -> None:
        """Remove the colours."""
        self._colours: RegionColourLearningOutputs | None = None

    def learn(
        self,
        model: ModelPreparationOutputs,
        T_camera_body: FloatArray,
        image: ByteArray,
        camera_matrix: FloatArray,
    ) -> None:
        """Learn the colours of body and background from an image.

        Without pixels of both, the colours stay the same.

        Parameters
        ----------
        T_camera_body : ndarray, shape (4, 4)
        image : ndarray of uint8, shape (r, c, d)
        camera_matrix : ndarray, shape (3, 3)
            Pixels; (0, 0) is the centre of the first pixel.
        """
        previous_colours = self._colours
        learned: RegionColourLearningOutputs = self._learn.process(
            RegionColourLearningInputs(
                image=image,
                camera_matrix=camera_matrix,
                pose=T_camera_body,
                vertices=model.drawn_vertices,
                triangles=model.drawn_triangles,
                body_colours=None if previous_colours is None else previous_colours.body_colours,
                background_colours=None if previous_colours is None else previous_colours.background_colours,
            )
        )
        if learned.body_colours.any() and learned.background_colours.any():
            self._colours = learned

    def fit(
        self,
        model: ModelPreparationOutputs,
        predicted: TrackedState,
        image: ByteArray,
        camera_matrix: FloatArray,
    ) -> RegionFit:
        """Return the state corrected by an image; unknown colours are first learned at the prediction.

        Parameters
        ----------
        model, predicted, camera_matrix
            As in ``ImageFitter.fit``.
        image : ndarray of uint8, shape (r, c, d)
            One or three channels, without lens distortion.

        Raises
        ------
        RefusedError
            ``few_lines:n<m``, ``no_colours`` or ``behind_camera``.
        """
        range_px = search_range_px(
            model, predicted.T, predicted.covariance[:6, :6], camera_matrix, self._max_range_px
        )
        if self._colours is None:
            self.learn(model, predicted.T, image, camera_matrix)
        if self._colours is None:
            raise RefusedError("no pixel is on one side of the outline in the image", ["no_colours"])
        state = predicted
        for k in range(_ROUNDS):
            line_offsets = self._regions.process(
                ModelRegionMeasurementInputs(
                    image=image,
                    camera_matrix=camera_matrix,
                    pose=state.T,
                    vertices=model.drawn_vertices,
                    triangles=model.drawn_triangles,
                    body_colours=self._colours.body_colours,
                    background_colours=self._colours.background_colours,
                    range_px=range_px,
                )
            )
            count = len(line_offsets.points)
            require_count(count, _MIN_LINES, f"{count} lines across the outline in the image", "few_lines")
            state, outputs = corrected_state(
                self._refine, state, predicted, line_offsets, camera_matrix, range_px
            )
            if k > 0 and range_px <= _MIN_RANGE_PX:
                break
            range_px = max(0.5 * range_px, _MIN_RANGE_PX)
        distance = state.squared_distance(predicted)
        return RegionFit(state, distance, outputs.agreement, len(line_offsets.points))
