# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Message and quality of detected objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import ObjectDetection, ObjectDetections, Time, TransformWithCovariance
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.object_models.prepared import body_frame
from cdff_core.object_models.scan_detection import Hypothesis


def detections_message(
    hypotheses: Sequence[Hypothesis],
    models: Mapping[str, ModelPreparationOutputs],
    *,
    stamp_ns: int,
    frame: str,
    producer: str,
) -> ObjectDetections:
    """Return the message of hypotheses in the frame of a sensor, in their order."""
    detections = []
    for hypothesis in hypotheses:
        model = models[hypothesis.name]
        pose = TransformWithCovariance.from_transform(
            UncertainTransform(hypothesis.T, hypothesis.covariance),
            parent=frame,
            child=body_frame(hypothesis.name),
            stamp_ns=stamp_ns,
            producer=producer,
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
        time_stamp=Time.from_ns(stamp_ns),
        producer_id=producer,
        sensor_id=frame,
        frame_id=frame,
        detections=tuple(detections),
    )


def detections_quality(
    hypotheses: Sequence[Hypothesis],
    models: Mapping[str, ModelPreparationOutputs],
    reasons: Sequence[str],
    metrics: Mapping[str, float],
    faults: Sequence[str] = (),
) -> Quality:
    """Return FAILED ``not_found`` with reasons, or the quality of hypotheses.

    DEGRADED ``ambiguous:n`` if n of them are alternatives, ``symmetric_model:n`` if a model has n equivalent
    poses, and for each of ``faults``.
    """
    if not hypotheses:
        return Quality.failed("not_found", *reasons, metrics=metrics)
    alternatives = sum(hypothesis.is_alternative for hypothesis in hypotheses)
    equivalent = max(len(models[hypothesis.name].symmetries) for hypothesis in hypotheses)
    degraded = [f"ambiguous:{alternatives}"] if alternatives else []
    degraded += [f"symmetric_model:{equivalent}"] if equivalent > 1 else []
    degraded += faults
    all_metrics = {**metrics, "detections": float(len(hypotheses) - alternatives)}
    is_known = all(hypothesis.covariance is not None for hypothesis in hypotheses)
    kind = CovarianceKind.FORMAL if is_known else CovarianceKind.NONE
    return Quality.from_reasons(degraded, kind, all_metrics)
