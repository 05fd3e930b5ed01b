# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the compounds that detect known bodies with their meshes: models, waiting sample, output."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import ObjectDetections
from cdff_core.object_models.compilation import compile_kernels
from cdff_core.object_models.detection_output import detections_message, detections_quality
from cdff_core.object_models.prepared import PreparedModels
from cdff_core.object_models.scan_detection import Hypothesis


class BodyDetection(Dfpc):
    """Compound that detects bodies in each sample of a sensor; a subclass processes the sample."""

    def setup_models(self, unit: str) -> None:
        """Create the DFN that prepares the models; ``unit`` is the length unit of their vertices.

        The state is cleared, and the store item is offered.
        """
        self._models = PreparedModels(self.dfn("prepare"), unit)
        compile_kernels()
        self._waiting: Sample | None = None
        self._last: ObjectDetections | None = None
        self._model_ids: dict[str, str] = {}
        self._stated_symmetries: dict[str, int] = {}
        self.store.offer("last_detections", lambda: self._last)

    def clear_models(self) -> None:
        """Remove all models."""
        self._models.clear()
        self._model_ids.clear()
        self._stated_symmetries.clear()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare and store the model; process the sample that waited for a model."""
        name = self._models.add(sample.value)
        self._model_ids[name] = sample.id
        self._stated_symmetries.pop(name, None)
        if "symmetries" in sample.quality.metrics:
            self._stated_symmetries[name] = int(sample.quality.metrics["symmetries"])
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else self.detect(waiting)

    def detect(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in the sample; without a model the sample waits."""
        models = self._models.by_name
        if not models:
            self._waiting = sample
            return ()
        metrics: dict[str, float] = {}
        hypotheses: list[Hypothesis] = []
        try:
            hypotheses, reasons = self._hypotheses(sample, metrics)
            faults = [*self._limits(sample), *self._symmetry_faults({h.name for h in hypotheses})]
            quality = detections_quality(hypotheses, models, reasons, metrics, faults)
        except (InputError, RefusedError) as error:
            quality = Quality.from_error(error, metrics)
        if not hypotheses:
            return [self._output(sample, None, quality)]
        self._last = detections_message(
            hypotheses, models, stamp_ns=sample.stamp_ns, frame=self._frame(sample), producer=self.name
        )
        return [self._output(sample, self._last, quality)]

    def finish(self) -> Iterable[Output]:
        """Return FAILED no_model for a sample that still waits."""
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else [self._output(waiting, None, Quality.failed("no_model"))]

    def _limits(self, sample: Sample) -> list[str]:
        """Return the reasons why all poses of a sample are DEGRADED."""
        return []

    def _symmetry_faults(self, names: Iterable[str]) -> list[str]:
        """Return how the symmetries stated with the meshes of some bodies differ from those of the meshes."""
        return [
            f"symmetries_of_{name}:{stated} stated, {found} found"
            for name in sorted(names)
            if (stated := self._stated_symmetries.get(name)) is not None
            and stated != (found := len(self._models.by_name[name].symmetries))
        ]

    @abstractmethod
    def _hypotheses(self, sample: Sample, metrics: dict[str, float]) -> tuple[list[Hypothesis], list[str]]:
        """Return the hypotheses of all bodies, best first, and the reasons why the others are refused."""

    @abstractmethod
    def _frame(self, sample: Sample) -> str:
        """Return the frame of the sensor."""

    def _output(self, sample: Sample, value: ObjectDetections | None, quality: Quality) -> Output:
        """Return the detections of a sample as an output."""
        return Output(
            "detections",
            value,
            sample.stamp_ns,
            sample.stamp_ns,
            self._frame(sample),
            quality=quality,
            inputs=(*self._model_ids.values(), sample.id),
        )
