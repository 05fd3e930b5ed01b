# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of BundleAdjustment."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class BundleAdjustmentConfig(DfpcConfig):
    """Parameters of the DFN slot, and the noise of the observations."""

    sigma_px: float = Field(
        1.0, gt=0, le=100, description="Standard deviation of an observed column or row, pixels"
    )
