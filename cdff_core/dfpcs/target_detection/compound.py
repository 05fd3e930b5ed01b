# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of TargetDetection: prepare the models, examine each body of a scan, publish."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_core.dfpcs.target_detection.configuration import TargetDetectionConfig
from cdff_core.dfpcs.target_detection.interface import TargetDetectionInterface
from cdff_core.object_models.body_detection import BodyDetection
from cdff_core.object_models.scan_detection import (
    DetectionLimits,
    Hypothesis,
    ScanDetector,
    no_body_reasons,
    valid_points,
)
from cdff_core.object_models.scan_parts import bodies


class TargetDetection(BodyDetection, TargetDetectionInterface):
    """Detection of known bodies in each scan."""

    Config = TargetDetectionConfig
    config: TargetDetectionConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        cfg, seed = self.config, self.context.seed
        limits = DetectionLimits(cfg.sigma_m, cfg.min_points, cfg.min_score, cfg.ambiguity)
        self._detector = ScanDetector(self.dfn("search", seed=seed), self.dfn("refine", seed=seed), limits)
        self.setup_models(cfg.unit)

    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in the scan; without a model the scan waits."""
        return self.detect(sample)

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in a scan whose points have times."""
        return self.detect(sample)

    def _frame(self, sample: Sample) -> str:
        return str(sample.value.frame)

    def _hypotheses(self, sample: Sample, metrics: dict[str, float]) -> tuple[list[Hypothesis], list[str]]:
        """Return the accepted hypotheses of all bodies, best first, and the reasons against the others."""
        points_m = valid_points(sample.value.points_m)[0]
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
