# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualOdometrySparse."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class VisualOdometrySparseConfig(DfpcConfig):
    """Parameters of keyframes and covariance, and the parameters of the DFN slots."""

    keyframe_survival: Annotated[
        float, Field(gt=0, lt=1, description="fraction of a keyframe's points below which it is replaced")
    ] = 0.6
    window: Annotated[
        int, Field(ge=1, le=8, description="number of keyframes relative to which a new keyframe is located")
    ] = 1
