# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of PointCloudMatching."""

from __future__ import annotations

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.cloud_matching.configuration import MatchingGates


class PointCloudMatchingConfig(MatchingGates, DfpcConfig):
    """Matching gates, and the parameters of the DFN slots."""
