# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of PoseSmoother."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc, DfpcConfig, Output, Sample
from cdff_common.types import TransformWithCovariance
from cdff_example_plugin.dfns.position_smoothing.interface import PositionSmoothingInputs


class PoseSmootherConfig(DfpcConfig):
    """Parameters of PoseSmoother: one mapping for each DFN slot."""

    smooth: dict[str, Any] = Field({}, description="Parameters of PositionSmoothing")


class PoseSmoother(Dfpc):
    """Smooth the positions of a stream of poses."""

    name = "pose_smoother"
    Config: ClassVar[type[DfpcConfig]] = PoseSmootherConfig

    def setup(self) -> None:
        """Make the DFN and clear the previous position."""
        self._smooth = self.dfn("smooth")
        self._previous: NDArray[np.float64] | None = None

    def step(self, sample: Sample) -> Iterable[Output]:
        """Smooth one pose."""
        T = sample.value.transform
        outputs = self._smooth.process(
            PositionSmoothingInputs(position=T.matrix[:3, 3], previous=self._previous)
        )
        self._previous = outputs.smoothed
        value = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(T.matrix[:3, :3], outputs.smoothed), T.covariance),
            parent=sample.frame,
            child=sample.child,
            stamp_ns=sample.stamp_ns,
            producer=self.name,
        )
        return [
            Output(
                "smoothed",
                value,
                sample.stamp_ns,
                sample.stamp_ns,
                sample.frame,
                sample.child,
                inputs=(sample.id,),
            )
        ]
