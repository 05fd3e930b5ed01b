# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of ModelDetection: prepare the models, search each one in the depth image, publish."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import DistanceImage, ObjectDetections
from cdff_core.dfpcs.model_detection.configuration import ModelDetectionConfig
from cdff_core.dfpcs.model_detection.interface import ModelDetectionInterface
from cdff_core.object_models.compilation import compile_kernels
from cdff_core.object_models.depth_detection import DepthDetection, DepthDetector, separate
from cdff_core.object_models.detection_output import detections_message, detections_quality
from cdff_core.object_models.prepared import PreparedModels
from cdff_core.object_models.scan_detection import Hypothesis


class ModelDetection(ModelDetectionInterface):
    """Detection of known objects in each depth image."""

    Config = ModelDetectionConfig
    config: ModelDetectionConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        seed = self.context.seed
        self._models = PreparedModels(self.dfn("prepare"), self.config.unit)
        self._detector = DepthDetector(
            self.dfn("search", seed=seed),
            self.dfn("refine", seed=seed),
            self.dfn("registration"),
            self.config.detection,
            seed=seed,
        )
        compile_kernels()
        self._waiting: Sample | None = None
        self._last: ObjectDetections | None = None
        self._model_ids: dict[str, str] = {}
        self.store.offer("last_detections", lambda: self._last)

    def clear_models(self) -> None:
        """Remove all models."""
        self._models.clear()
        self._model_ids.clear()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare and store the model; search in the depth image that waited for one."""
        name = self._models.add(sample.value)
        self._model_ids[name] = sample.id
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else self.on_depth(waiting)

    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in the depth image; without a model the image waits."""
        models = self._models.by_name
        if not models:
            self._waiting = sample
            return ()
        found: list[Hypothesis] = []
        try:
            found, reasons = self._detect(sample.value)
            quality = detections_quality(found, models, reasons, {})
        except InputError as error:
            quality = Quality.from_error(error)
        value = None
        if found:
            value = detections_message(
                found, models, stamp_ns=sample.stamp_ns, frame=_frame(sample), producer=self.name
            )
        self._last = value or self._last
        return [self._output(sample, value, quality)]

    def finish(self) -> Iterable[Output]:
        """Return FAILED no_model for a depth image that still waits."""
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else [self._output(waiting, None, Quality.failed("no_model"))]

    def _detect(self, image: DistanceImage) -> tuple[list[Hypothesis], list[str]]:
        """Return the hypotheses of all objects, best first, and the reasons against the other parts."""
        reasons: list[str] = []
        found: list[tuple[DepthDetection, float]] = []
        for name, model in self._models.by_name.items():
            try:
                detections = self._detector.detect(name, model, image)
            except RefusedError as error:
                reasons += error.reasons
                continue
            found += [(detection, model.diameter_m) for detection in detections]
        return [h for detection in separate(found) for h in detection.hypotheses], reasons

    def _output(self, sample: Sample, value: ObjectDetections | None, quality: Quality) -> Output:
        return Output(
            "detections",
            value,
            sample.stamp_ns,
            sample.stamp_ns,
            _frame(sample),
            quality=quality,
            inputs=(*self._model_ids.values(), sample.id),
        )


def _frame(sample: Sample) -> str:
    """Return the frame of the camera; depth images have none of their own."""
    return sample.frame or "camera"
