# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of TargetDetection: prepare the models, examine each body of a scan, publish."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import ObjectDetections
from cdff_core.dfpcs.target_detection.configuration import TargetDetectionConfig
from cdff_core.dfpcs.target_detection.interface import TargetDetectionInterface
from cdff_core.object_models.compilation import compile_kernels
from cdff_core.object_models.detection_output import detections_message, detections_quality
from cdff_core.object_models.prepared import PreparedModels
from cdff_core.object_models.scan_detection import (
    DetectionLimits,
    Hypothesis,
    ScanDetector,
    no_body_reasons,
    valid_points,
)
from cdff_core.object_models.scan_parts import bodies


class TargetDetection(TargetDetectionInterface):
    """Detection of known bodies in each scan."""

    Config = TargetDetectionConfig
    config: TargetDetectionConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        self._models = PreparedModels(self.dfn("prepare"), self.config.unit)
        cfg, seed = self.config, self.context.seed
        limits = DetectionLimits(cfg.sigma_m, cfg.min_points, cfg.min_score, cfg.ambiguity)
        self._detector = ScanDetector(self.dfn("search", seed=seed), self.dfn("refine", seed=seed), limits)
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
        """Prepare and store the model; examine the scan that waited for one."""
        name = self._models.add(sample.value)
        self._model_ids[name] = sample.id
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else self.on_cloud(waiting)

    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in the scan; without a model the scan waits."""
        if not self._models.by_name:
            self._waiting = sample
            return ()
        metrics: dict[str, float] = {}
        found: list[Hypothesis] = []
        try:
            found, reasons = self._detect(valid_points(sample.value.points_m)[0], metrics)
            quality = detections_quality(found, self._models.by_name, reasons, metrics)
        except (InputError, RefusedError) as error:
            quality = Quality.from_error(error, metrics)
        value = None
        if found:
            value = detections_message(
                found,
                self._models.by_name,
                stamp_ns=sample.stamp_ns,
                frame=sample.value.frame,
                producer=self.name,
            )
        self._last = value or self._last
        return [
            Output(
                "detections",
                value,
                sample.stamp_ns,
                sample.stamp_ns,
                sample.value.frame,
                quality=quality,
                inputs=(*self._model_ids.values(), sample.id),
            )
        ]

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in a scan whose points have times."""
        return self.on_cloud(sample)

    def finish(self) -> Iterable[Output]:
        """Return FAILED no_model for a scan that still waits."""
        waiting, self._waiting = self._waiting, None
        if waiting is None:
            return ()
        stamp_ns, frame = waiting.stamp_ns, waiting.value.frame
        return [Output("detections", None, stamp_ns, stamp_ns, frame, quality=Quality.failed("no_model"))]

    def _detect(self, points_m: FloatArray, metrics: dict[str, float]) -> tuple[list[Hypothesis], list[str]]:
        """Return the accepted hypotheses of all bodies, best first, and the reasons against the others."""
        metrics["points"] = float(len(points_m))
        if len(points_m) < self.config.min_points:
            raise RefusedError(
                f"a scan of {len(points_m)} points", [f"few_points:{len(points_m)}<{self.config.min_points}"]
            )
        reasons: list[str] = []
        accepted: dict[int, list[Hypothesis]] = {}
        for name, model in self._models.by_name.items():
            parts = bodies(points_m, model.diameter_m)[: self.config.max_bodies]
            metrics["bodies"] = float(len(parts))
            if not parts:
                reasons += no_body_reasons(points_m, model.diameter_m)
            for rows in parts:
                try:
                    hypotheses = self._detector.detect(name, model, points_m[rows], metrics)
                except RefusedError as error:
                    reasons += error.reasons
                    continue
                key = int(rows[0])
                if key not in accepted or hypotheses[0].score > accepted[key][0].score:
                    accepted[key] = hypotheses
        groups = sorted(accepted.values(), key=lambda group: -group[0].score)
        return [hypothesis for group in groups for hypothesis in group], reasons
