# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Acceptance of the images of a pair: black, flat, saturated and frozen ones are refused."""

from __future__ import annotations

from typing import Any

from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.image_assessment.interface import ImageAssessmentInputs, ImageAssessmentOutputs
from cdff_core.stereo_odometry.limits import below
from cdff_core.stereo_odometry.stereo_view import StereoView

#: Contrast of an image, twice the range of noise of 1 DN; an image with less contrast is black or flat.
MIN_CONTRAST_DN = 10.0
#: Fraction of saturated pixels.
MAX_SATURATION = 0.5


def assess_pair(
    assessment: Dfn[Any, Any, Any], view: StereoView, previous: StereoView | None
) -> tuple[bool, float]:
    """Return whether a pair repeats the previous one, and its sharpness; raises RefusedError."""
    images = (None, None) if previous is None else (previous.left, previous.right)
    left, right = (
        assessment.process(ImageAssessmentInputs(image=image, previous=previous_image))
        for image, previous_image in zip((view.left, view.right), images, strict=True)
    )
    check_images(left, right)
    return left.change == 0.0, min(left.sharpness, right.sharpness)


def check_images(left: ImageAssessmentOutputs, right: ImageAssessmentOutputs) -> None:
    """Raise RefusedError on unusable images: black, flat, saturated, or one of them frozen."""
    reasons = []
    sides = (("left", left), ("right", right))
    for side, image in sides:
        reasons += below(image.contrast, MIN_CONTRAST_DN, f"low_contrast_{side}", digits=0)
        if image.saturation > MAX_SATURATION:
            reasons.append(f"saturated_{side}:{image.saturation:.2f}>{MAX_SATURATION:.2f}")
    frozen = [side for side, image in sides if image.change == 0.0]
    if len(frozen) == 1:
        reasons.append(f"frozen_image:{frozen[0]}")
    if reasons:
        raise RefusedError("images cannot be used: " + ", ".join(reasons), reasons)
