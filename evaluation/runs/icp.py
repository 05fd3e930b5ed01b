# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run icp_localisation for evaluations and benchmarks."""

from __future__ import annotations

import time
from typing import Any

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud, TransformWithCovariance

IMPLEMENTATIONS = ("PointToPlane", "Gicp", "Accurate", "Fast", "Quick")


def make_dfpc(implementation: str | None = None, **config: Any) -> Any:
    """Return the configured DFPC."""
    dfpc = Registry.default().make_dfpc("icp_localisation")
    dfpc.configure(config, implementation=implementation)
    return dfpc


def localise(
    dfpc: Any, scene: FloatArray, model: FloatArray, guess: FloatArray | None = None
) -> tuple[Output, float]:
    """Return the output for a model in a scene, and CPU seconds; the default guess is the identity."""
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
