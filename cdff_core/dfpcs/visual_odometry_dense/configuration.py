# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualOdometryDense."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class VisualOdometryDenseConfig(DfpcConfig):
    """Parameters of keyframes, and the parameters of the DFN slots."""

    keyframe_overlap: Annotated[
        float,
        Field(gt=0, lt=1, description="fraction of a keyframe's pixels in view below which it is replaced"),
    ] = 0.7
    keyframe_motion: Annotated[
        float,
        Field(
            gt=0,
            lt=1,
            description="median displacement of the pixels, relative to the image width, above which the "
            "keyframe is replaced",
        ),
    ] = 0.03
