# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction and correction of the direction of an object."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.bearing_tracking.motion import BearingStates
from cdff_core.dfns.bearing_filtering.interface import BearingFilteringInputs
from cdff_core.dfpcs.far_range_tracking.scene import Scene
from cdff_core.dfpcs.far_range_tracking.tracked_object import TrackedObject

#: Variation of the position of an object in full view due to its region and its illumination, relative to its
#: size: it does not average out over a few images.
_CLEAR_ERROR = 0.05


class ObjectMotion:
    """Two filters of each object: one of all images, and a slower one of the images in full view.

    While an object is hidden step by step, its positions are biased towards its visible part. The slower
    filter does not use them; it predicts the object after it is hidden.

    Parameters
    ----------
    filter_seen, coast : Dfn
        Filter of all images, and the slower filter.
    """

    def __init__(self, filter_seen: Dfn[Any, Any, Any], coast: Dfn[Any, Any, Any]) -> None:
        self._filter, self._coast = filter_seen, coast

    def predicted(self, o: TrackedObject, interval_s: float) -> BearingStates:
        """Return the state of an object after an interval."""
        return _predicted(self._filter if o.misses == 0 else self._coast, o.states, interval_s)

    def predict(self, o: TrackedObject, interval_s: float, moved_m: FloatArray) -> None:
        """Predict an object; the translation (3,) of the observer moves it if its range is known."""
        o.states = self.predicted(o, interval_s)
        o.clear_states = _predicted(self._coast, o.clear_states, interval_s)
        range_m, _ = o.range.value
        if np.isfinite(range_m) and moved_m.any():
            o.states, o.clear_states = (
                _seen_from_new_position(s, range_m, moved_m) for s in (o.states, o.clear_states)
            )

    def corrected(
        self, o: TrackedObject, pixel: FloatArray, covariance: FloatArray, scene: Scene
    ) -> tuple[BearingStates, float]:
        """Return the state corrected with an image position (2,), and the squared normalised innovation."""
        return _corrected(self._filter, o.states, pixel, covariance, scene)

    def correct_clear(
        self, o: TrackedObject, pixel: FloatArray, covariance: FloatArray, scene: Scene
    ) -> None:
        """Correct the slower filter with the image position (2,) of an object in full view."""
        variation = (_CLEAR_ERROR * float(o.size_px.max())) ** 2 * np.eye(2)
        o.clear_states, _ = _corrected(self._coast, o.clear_states, pixel, covariance + variation, scene)


def _predicted(dfn: Dfn[Any, Any, Any], s: BearingStates, interval_s: float) -> BearingStates:
    prediction = dfn.process(
        BearingFilteringInputs(
            directions=s.directions, rates=s.rates, covariances=s.covariances, interval=interval_s
        )
    )
    return BearingStates(prediction.directions, prediction.rates, prediction.covariances)


def _corrected(
    dfn: Dfn[Any, Any, Any], s: BearingStates, pixel: FloatArray, covariance: FloatArray, scene: Scene
) -> tuple[BearingStates, float]:
    attitude = scene.observer.attitude
    direction = attitude.directions(scene.camera, pixel[None])
    filtered = dfn.process(
        BearingFilteringInputs(
            directions=s.directions,
            rates=s.rates,
            covariances=s.covariances,
            interval=0.0,
            measured=direction,
            measured_covariances=attitude.covariances(scene.camera, covariance[None], direction),
        )
    )
    return BearingStates(filtered.directions, filtered.rates, filtered.covariances), float(filtered.nis[0])


def _seen_from_new_position(s: BearingStates, range_m: float, moved_m: FloatArray) -> BearingStates:
    u = range_m * s.directions[0] - moved_m
    return BearingStates((u / np.linalg.norm(u))[None], s.rates, s.covariances)
