# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of NavigationMapping."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class NavigationMappingConfig(DfpcConfig):
    """Size and cells of the map, and the DFNs' parameters."""

    size_m: float = Field(30.0, gt=0.0, le=1000.0, description="Edge of the square map, metres")
    resolution_m: float = Field(
        0.1,
        gt=0.0,
        le=100.0,
        description="Largest cell size, metres; the actual one is a multiple of the cell size of the patches",
    )
