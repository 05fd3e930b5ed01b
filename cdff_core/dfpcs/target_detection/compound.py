# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of TargetDetection: prepare the models, examine each body of a scan, publish."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import ObjectDetection, ObjectDetections, Time, TransformWithCovariance
from cdff_core.dfns.model_pose_refinement.interface import (
    ModelPoseRefinementInputs,
    ModelPoseRefinementOutputs,
)
from cdff_core.dfns.model_pose_search.interface import ModelPoseSearchInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfpcs.target_detection.configuration import TargetDetectionConfig
from cdff_core.dfpcs.target_detection.interface import TargetDetectionInterface
from cdff_core.object_models.prepared import PreparedModels, body_frame
from cdff_core.object_models.scan_parts import bodies, range_noise

#: Largest extent of a body relative to that of the model, and bounds of the noise relative to the model.
_MAX_SIZE, _MIN_SIGMA, _MAX_SIGMA = 1.6, 2e-4, 0.05
#: Relation of a scan to the model from which a wrong unit is the likely reason.
_WRONG_UNIT = 50.0
#: Poses closer than this, in rad and diameters of the model, are one.
_SAME_RAD, _SAME = 0.2, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class _Hypothesis:
    """An accepted pose of a model in a body of the scan; the first of a body has the lowest cost."""

    name: str
    T: FloatArray
    covariance: FloatArray
    score: float
    is_alternative: bool


class TargetDetection(TargetDetectionInterface):
    """Detection of known bodies in each scan."""

    Config = TargetDetectionConfig
    config: TargetDetectionConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        self._models = PreparedModels(self.dfn("prepare"), self.config.unit)
        self._search = self.dfn("search", seed=self.context.seed)
        self._refine = self.dfn("refine", seed=self.context.seed)
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
        found: list[_Hypothesis] = []
        try:
            found, reasons = self._detect(_valid_points(sample), metrics)
            quality = self._quality(found, reasons, metrics)
        except (InputError, RefusedError) as error:
            quality = Quality.from_error(error, metrics)
        value = self._message(sample, found) if found else None
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

    def finish(self) -> Iterable[Output]:
        """Return FAILED no_model for a scan that still waits."""
        waiting, self._waiting = self._waiting, None
        if waiting is None:
            return ()
        stamp_ns, frame = waiting.stamp_ns, waiting.value.frame
        return [Output("detections", None, stamp_ns, stamp_ns, frame, quality=Quality.failed("no_model"))]

    def _detect(self, points_m: FloatArray, metrics: dict[str, float]) -> tuple[list[_Hypothesis], list[str]]:
        """Return the accepted hypotheses of all bodies, best first, and the reasons against the others."""
        metrics["points"] = float(len(points_m))
        if len(points_m) < self.config.min_points:
            raise RefusedError(
                f"a scan of {len(points_m)} points", [f"few_points:{len(points_m)}<{self.config.min_points}"]
            )
        reasons: list[str] = []
        accepted: dict[int, list[_Hypothesis]] = {}
        for name, model in self._models.by_name.items():
            parts = bodies(points_m, model.diameter_m)[: self.config.max_bodies]
            metrics["bodies"] = float(len(parts))
            if not parts:
                reasons.append("no_body")
            for rows in parts:
                try:
                    hypotheses = self._examine(name, model, points_m[rows], metrics)
                except RefusedError as error:
                    reasons += error.reasons
                    continue
                key = int(rows[0])
                if key not in accepted or hypotheses[0].score > accepted[key][0].score:
                    accepted[key] = hypotheses
        groups = sorted(accepted.values(), key=lambda group: -group[0].score)
        return [hypothesis for group in groups for hypothesis in group], reasons

    def _examine(
        self, name: str, model: ModelPreparationOutputs, scan_m: FloatArray, metrics: dict[str, float]
    ) -> list[_Hypothesis]:
        """Return the accepted poses of a model in a body of the scan; RefusedError with reasons if none."""
        cfg = self.config
        if len(scan_m) < cfg.min_points:
            raise RefusedError(f"{len(scan_m)} points", [f"few_points:{len(scan_m)}<{cfg.min_points}"])
        self._check_size(model, scan_m)
        least_m, most_m = (limit * model.diameter_m for limit in (_MIN_SIGMA, _MAX_SIGMA))
        sigma_m = cfg.sigma_m or min(max(range_noise(scan_m), least_m), most_m)
        surface: dict[str, Any] = {
            "points": model.points,
            "normals": model.normals,
            "grid_index": model.grid_index,
            "grid_low": model.grid_low,
            "grid_cell_m": model.grid_cell_m,
            "diameter_m": model.diameter_m,
        }
        found = self._search.process(
            ModelPoseSearchInputs(
                scan=scan_m,
                view_directions=model.view_directions,
                view_centroids=model.view_centroids,
                sigma_m=sigma_m,
                **surface,
            )
        )
        refined = self._refine.process(
            ModelPoseRefinementInputs(
                scan=scan_m,
                poses=found.poses,
                drawn_vertices=model.drawn_vertices,
                drawn_triangles=model.drawn_triangles,
                centre_m=model.centre_m,
                sigma_m=sigma_m,
                sigma_is_upper_bound=not cfg.sigma_m,
                **surface,
            )
        )
        scores = refined.rays[:, 0] / np.maximum(refined.rays.sum(axis=1), 1.0)
        metrics |= {"score": float(scores[0]), "sigma_m": refined.sigma_m, "cost": float(refined.costs[0])}
        if scores[0] < cfg.min_score:
            raise RefusedError(
                f"{name}: score {scores[0]:.2f}", [f"low_score:{scores[0]:.2f}<{cfg.min_score:g}"]
            )
        return [
            _Hypothesis(name, refined.poses[i], refined.covariances[i], float(scores[i]), i > 0)
            for i in self._alternatives(model, refined)
        ]

    def _alternatives(self, model: ModelPreparationOutputs, refined: ModelPoseRefinementOutputs) -> list[int]:
        """Return the rows of the best pose and of others that explain the scan nearly as well."""
        rows = [0]
        for i in range(1, len(refined.poses)):
            if refined.costs[i] - refined.costs[0] > self.config.ambiguity:
                continue
            if not any(_is_equivalent(model, refined.poses[i], refined.poses[k]) for k in rows):
                rows.append(i)
        return rows

    def _check_size(self, model: ModelPreparationOutputs, scan_m: FloatArray) -> None:
        low, high = np.quantile(scan_m, [0.02, 0.98], axis=0)
        ratio = float(np.linalg.norm(high - low)) / model.diameter_m
        if ratio > _MAX_SIZE:
            hint = ["wrong_unit"] if ratio > _WRONG_UNIT else []
            raise RefusedError("the body is larger than the model", [f"too_large:{ratio:.3g}", *hint])
        if ratio < 1.0 / _WRONG_UNIT:
            raise RefusedError("the body is smaller than the model", [f"too_small:{ratio:.3g}", "wrong_unit"])

    def _quality(self, found: list[_Hypothesis], reasons: list[str], metrics: dict[str, float]) -> Quality:
        if not found:
            return Quality.failed("not_found", *reasons, metrics=metrics)
        alternatives = sum(hypothesis.is_alternative for hypothesis in found)
        equivalent = max(len(self._models.by_name[hypothesis.name].symmetries) for hypothesis in found)
        degraded = [f"ambiguous:{alternatives}"] if alternatives else []
        degraded += [f"symmetric_model:{equivalent}"] if equivalent > 1 else []
        metrics |= {"detections": float(len(found) - alternatives)}
        return Quality.from_reasons(degraded, CovarianceKind.FORMAL, metrics)

    def _message(self, sample: Sample, found: list[_Hypothesis]) -> ObjectDetections:
        detections = []
        for hypothesis in found:
            model = self._models.by_name[hypothesis.name]
            pose = TransformWithCovariance.from_transform(
                UncertainTransform(hypothesis.T, hypothesis.covariance),
                parent=sample.value.frame,
                child=body_frame(hypothesis.name),
                stamp_ns=sample.stamp_ns,
                producer=self.name,
            )
            detections.append(
                ObjectDetection.from_pose(
                    hypothesis.name,
                    hypothesis.score,
                    pose,
                    size_m=np.ptp(model.points, axis=0),
                    symmetric=hypothesis.T @ model.symmetries[1:],
                )
            )
        return ObjectDetections(
            time_stamp=Time.from_ns(sample.stamp_ns),
            producer_id=self.name,
            sensor_id=sample.value.frame,
            frame_id=sample.value.frame,
            detections=tuple(detections),
        )


def _valid_points(sample: Sample) -> FloatArray:
    """Return the finite points (n, 3) of a scan that are not at the sensor, metres."""
    points: FloatArray = np.asarray(sample.value.points_m, np.float64)
    is_valid = np.isfinite(points).all(axis=1) & (np.abs(points).max(axis=1, initial=0.0) > 0.0)
    return np.asarray(points[is_valid])


def _is_equivalent(model: ModelPreparationOutputs, first: FloatArray, second: FloatArray) -> bool:
    """Return whether two poses are one, or equivalent by the symmetry of the model."""
    differences = se3.inverse(first) @ second @ model.symmetries
    centre = np.append(model.centre_m, 1.0)
    moved_m = np.linalg.norm((differences @ centre)[:, :3] - model.centre_m, axis=1)
    is_same = (se3.rotation_angle(differences[:, :3, :3]) < _SAME_RAD) & (moved_m < _SAME * model.diameter_m)
    return bool(is_same.any())
