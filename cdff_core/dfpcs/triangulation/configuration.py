# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of Triangulation."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class TriangulationConfig(DfpcConfig):
    """Camera of matched images, size of clouds, and parameters of the DFN slots."""

    camera: tuple[float, float, float, float] | None = Field(
        None, description="fx fy cx cy of the camera of matched images, pixels"
    )
    max_points: Annotated[int, Field(ge=1, le=400_000)] = Field(
        400_000, description="Maximum number of points of a cloud"
    )
