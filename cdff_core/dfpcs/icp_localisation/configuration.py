# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of IcpLocalisation."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.cloud_matching.configuration import AcceptanceGates


class IcpLocalisationConfig(AcceptanceGates, DfpcConfig):
    """Parameters of the DFN slots and of the restarts, and the gates that an alignment must pass."""

    assessed_level: Literal["medium", "fine"] = Field("fine", description="Level of the assessment")
    normals_to_fine: bool = Field(True, description="Pass normals to register_fine (Ndt needs none)")
    min_overlap: float = Field(
        0.4, gt=0, le=1, description="Larger of the overlaps of model and scene: FAILED below"
    )
    good_overlap: float = Field(
        0.6, gt=0, le=1, description="Larger of the overlaps of model and scene: DEGRADED below"
    )
    restarts: int = Field(6, ge=0, le=6, description="Displaced restarts after a failure")
    confirmations: int = Field(
        2, ge=0, le=6, description="Displaced restarts that must not lead to another, equally good result"
    )
