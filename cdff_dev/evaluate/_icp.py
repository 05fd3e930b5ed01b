# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""icp_localisation as evaluations and benchmarks call it."""

from __future__ import annotations

import time
from typing import Any

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud, TransformWithCovariance

IMPLEMENTATIONS = ("PointToPlane", "Gicp", "Accurate", "Fast")


def made(implementation: str | None = None, **config: Any) -> Any:
    """The DFPC, configured."""
    dfpc = Registry.default().make_dfpc("icp_localisation")
    dfpc.configure(config, implementation=implementation)
    return dfpc


def localised(dfpc: Any, scene: FloatArray, model: FloatArray, guess: FloatArray | None = None) -> tuple[Output, float]:
    """The output for a model and a scene, from a guess or the identity, and the CPU seconds of both clouds."""
    dfpc.forget()
    samples = [
        Sample(name, 0, 0, Pointcloud.from_points(points, frame=name, stamp_ns=0))
        for name, points in (("model", model), ("scene", scene))
    ]
    if guess is not None:
        T = UncertainTransform(guess)
        value = TransformWithCovariance.from_transform(T, parent="scene", child="model", stamp_ns=0)
        samples.insert(0, Sample("guess", 0, 0, value))
    started = time.process_time()
    (output,) = [output for sample in samples for output in dfpc.step(sample)]
    return output, time.process_time() - started
