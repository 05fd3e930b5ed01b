# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of ModelDetection: prepare the models, search each one in the depth image, publish."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_core.dfpcs.model_detection.configuration import ModelDetectionConfig
from cdff_core.dfpcs.model_detection.interface import ModelDetectionInterface
from cdff_core.object_models.body_detection import BodyDetection
from cdff_core.object_models.depth_detection import DepthDetection, DepthDetector, separate
from cdff_core.object_models.scan_detection import Hypothesis


class ModelDetection(BodyDetection, ModelDetectionInterface):
    """Detection of known objects in each depth image."""

    Config = ModelDetectionConfig
    config: ModelDetectionConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        seed = self.context.seed
        self._detector = DepthDetector(
            self.dfn("search", seed=seed),
            self.dfn("refine", seed=seed),
            self.dfn("registration"),
            self.config.detection,
            seed=seed,
        )
        self.setup_models(self.config.unit)

    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in the depth image; without a model the image waits."""
        return self.detect(sample)

    def _hypotheses(self, sample: Sample, metrics: dict[str, float]) -> tuple[list[Hypothesis], list[str]]:
        """Return the hypotheses of all objects, best first, and the reasons
        why the other parts are refused.
        """
        reasons: list[str] = []
        detections_with_diameters: list[tuple[DepthDetection, float]] = []
        for name, model in self._models.by_name.items():
            try:
                detections = self._detector.detect(name, model, sample.value)
            except RefusedError as error:
                reasons += error.reasons
                continue
            detections_with_diameters += [(detection, model.diameter_m) for detection in detections]
        return [h for detection in separate(detections_with_diameters) for h in detection.hypotheses], reasons

    def _frame(self, sample: Sample) -> str:
        """Return the frame of the camera; depth images have none of their own."""
        return sample.frame or "camera"
