# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of ModelDetection."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.object_models.depth_detection import DepthDetectionConfig


class ModelDetectionConfig(DfpcConfig):
    """Parameters of the detection, and of the DFN slots."""

    unit: Literal["m", "mm", "cm", "km"] = Field(
        "m", description="Unit of the vertices of the models; depths are metres"
    )
    detection: DepthDetectionConfig = Field(
        DepthDetectionConfig(), description="Search and decision in a depth image"
    )
