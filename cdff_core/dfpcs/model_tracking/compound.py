# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of ModelTracking: the sequence of ``ImageTracking``, and detection without a track."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Output
from cdff_common.interfaces.product import Quality
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfpcs.model_tracking.configuration import ModelTrackingConfig
from cdff_core.dfpcs.model_tracking.interface import ModelTrackingInterface
from cdff_core.imaging.depth_images import RgbdSamples
from cdff_core.object_models.compilation import compile_kernels
from cdff_core.object_models.depth_detection import DepthDetector
from cdff_core.object_models.image_tracking import ImageTracking, ViewFit, moved
from cdff_core.object_models.scan_detection import Hypothesis


class ModelTracking(ImageTracking, ModelTrackingInterface):
    """Comparison of each image and its depth image with the mesh at the predicted state."""

    Config = ModelTrackingConfig
    config: ModelTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        self.setup_images()
        seed = self.context.seed
        self._detector = DepthDetector(
            self.dfn("search", seed=seed),
            self.dfn("refine_search", seed=seed),
            self.dfn("registration"),
            self.config.detection,
            self._R_camera_depth,
            seed,
        )
        compile_kernels()

    def restart(self) -> None:
        """Clear the track; the object is detected again."""
        super().restart()
        self._images_to_detection = 0

    def _without_track(self, view: RgbdSamples, model: ModelPreparationOutputs) -> Iterable[Output]:
        """Detect the object and start a track."""
        if not self._is_detection_due(view):
            reason = "no_depth" if view.depth is None else "waiting_for_detection"
            return self._outputs(view.newest, None, Quality.failed("no_guess", reason))
        return self._detect_object(view, model, [])

    def _without_fit(
        self, view: RgbdSamples, model: ModelPreparationOutputs, fit: ViewFit, reasons: list[str]
    ) -> Iterable[Output]:
        """Publish the prediction, or detect the object if it is lost."""
        is_lost = self._used == 0 or self._unused >= self.config.detect_after
        if is_lost and self._is_detection_due(view):
            return self._detect_object(view, model, fit.faults)
        return super()._without_fit(view, model, fit, reasons)

    def _is_detection_due(self, view: RgbdSamples) -> bool:
        """Return whether a detection is possible and the last one that failed is long enough ago."""
        if view.depth is None:
            return False
        self._images_to_detection = max(self._images_to_detection - 1, 0)
        return self._images_to_detection == 0

    def _detect_object(
        self, view: RgbdSamples, model: ModelPreparationOutputs, faults: list[str]
    ) -> Iterable[Output]:
        """Detect the object in the depth image: correct the track, or start one."""
        try:
            hypotheses = self._detect(view, model)
        except (InputError, RefusedError) as error:
            self._images_to_detection = self.config.detect_after
            if self._used == 0:
                self._state = None
                quality = Quality.failed("not_found", *faults, *Quality.from_error(error).reasons)
                return self._outputs(view.newest, None, quality)
            return self._published(view.newest, ["coasting", *faults, "not_found"], {})
        stamp_ns = view.newest.stamp_ns
        reasons = [*self._use_detection(model, hypotheses, stamp_ns), *faults]
        assert self._state is not None
        predicted_state, transition = self._filter.prediction(self._state, stamp_ns)
        fit = self._fit(view, model, predicted_state, transition)
        if fit.used:
            return self._used_fit(view, predicted_state, fit, reasons)
        self._state, self._last_used_ns = fit.state, stamp_ns
        return self._published(view.newest, [*reasons, *fit.faults], fit.metrics)

    def _detect(self, view: RgbdSamples, model: ModelPreparationOutputs) -> list[Hypothesis]:
        """Return the hypotheses of the best detection; raises RefusedError if there is none."""
        assert view.depth is not None
        best_detection, *_ = self._detector.detect(self._name, model, view.depth.value)
        offset_m = np.array(self.config.depth_offset_m)
        return [
            replace(hypothesis, T=moved(hypothesis.T, offset_m)) for hypothesis in best_detection.hypotheses
        ]
