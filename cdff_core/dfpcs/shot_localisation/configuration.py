# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of ShotLocalisation."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.cloud_matching.configuration import MatchingGates, Radii
from cdff_core.partial_views.configuration import ViewSearchConfig


class ShotLocalisationConfig(MatchingGates, DfpcConfig):
    """Matching gates for a model in a larger scene, and the parameters of the DFN slots."""

    support_voxels: Radii = Field(
        (12.0, 20.0, 8.0),
        min_length=1,
        max_length=8,
        description="Radii of the descriptors, in voxels, in the order of their use",
    )
    noise_voxels: float = Field(
        1.5, gt=0.0, le=20.0, description="Largest position error of a correct match, voxels"
    )
    min_overlap: float = Field(0.4, gt=0, le=1, description="Visible fraction of the model: FAILED below")
    good_overlap: float = Field(0.6, gt=0, le=1, description="Visible fraction of the model: DEGRADED below")
    view_search: ViewSearchConfig = Field(
        default_factory=ViewSearchConfig,
        description="Search in a single view, used if the descriptors yield no pose",
    )
