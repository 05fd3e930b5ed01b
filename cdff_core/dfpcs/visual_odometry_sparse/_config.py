# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualOdometrySparse."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.dfpcs.visual_odometry_sparse._verdict import Limits


class VisualOdometrySparseConfig(DfpcConfig):
    """Parameters of VisualOdometrySparse: its own, and per DFN slot a mapping with that DFN's."""

    limits: Limits = Limits()
    keyframe_survival: Annotated[float, Field(gt=0, lt=1)] = 0.6
    window: Annotated[
        int, Field(ge=1, le=8, description="A new key frame is located against so many of the last ones")
    ] = 1
    patience: Annotated[int, Field(ge=1, le=100)] = 2
    sigma_calibration_walk_px: Annotated[float, Field(ge=0, le=1)] = 0.002
    felt_memory_s: Annotated[float, Field(gt=0, le=600, description="Wheel poses and rates are kept so long, s")] = 10.0
    covariance_kind: Annotated[
        Literal["formal", "calibrated"],
        Field(description="calibrated where the poses of this camera, with these parameters, were held against truth"),
    ] = "formal"
    trajectory_length: Annotated[int, Field(ge=2)] = 100_000
    assessment: dict[str, Any] = {}
    extraction: dict[str, Any] = {}
    stereo_matching: dict[str, Any] = {}
    refinement: dict[str, Any] = {}
    triangulation: dict[str, Any] = {}
    prediction: dict[str, Any] = {}
    tracking: dict[str, Any] = {}
    description: dict[str, Any] = {}
    matching: dict[str, Any] = {}
    pnp: dict[str, Any] = {}
    motion: dict[str, Any] = {}
    gyro: dict[str, Any] = {}

    @model_validator(mode="after")
    def _window_is_formal(self) -> Self:
        if self.window > 1 and self.covariance_kind == "calibrated":
            raise ValueError(
                f"covariance_kind calibrated: expected formal with a window of {self.window} key frames, "
                "whose covariance is too small"
            )
        return self
