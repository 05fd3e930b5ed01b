# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of ShotLocalisation."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.cloud_matching.configuration import MatchingGates, Radii


class ShotLocalisationConfig(MatchingGates, DfpcConfig):
    """Matching gates, with scales and overlaps for a model in a larger scene, and DFN slots."""

    support_voxels: Radii = Field(
        (12.0, 20.0, 8.0),
        min_length=1,
        max_length=8,
        description="Radii of the descriptors, in voxels, tried in turn",
    )
    noise_voxels: float = Field(1.5, gt=0.0, le=20.0, description="Noise of correct matches, voxels")
    min_overlap: float = Field(0.4, gt=0, le=1, description="Visible ratio of the model: FAILED below")
    good_overlap: float = Field(0.6, gt=0, le=1, description="Visible ratio of the model: DEGRADED below")
