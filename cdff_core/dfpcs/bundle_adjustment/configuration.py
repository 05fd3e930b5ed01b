# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of BundleAdjustment."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class BundleAdjustmentConfig(DfpcConfig):
    """Parameters of the DFN slot, and the errors of observations and lenses."""

    sigma_px: float = Field(
        1.0, gt=0, le=100, description="Standard deviation of an observed column or row, pixels"
    )
    focal_length_ratio: float = Field(
        0.005,
        ge=0,
        le=0.2,
        description=(
            "Standard deviation of the relative error of focal lengths that are not estimated; the default "
            "is an assumption, 0 means that they are exact"
        ),
    )
