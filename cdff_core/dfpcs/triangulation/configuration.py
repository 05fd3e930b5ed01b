# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of Triangulation."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class TriangulationConfig(DfpcConfig):
    """The camera of matches and the size of clouds."""

    camera: tuple[float, float, float, float] | None = Field(
        None, description="fx fy cx cy of the camera of matches, pixels"
    )
    max_points: Annotated[int, Field(ge=1, le=400_000)] = Field(
        400_000, description="Greatest number of points of a cloud"
    )
