# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""When a result is DEGRADED or FAILED: the limits, and the functions that hold a result against them."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import StrictModel
from cdff_core.dfns.image_assessment._interface import ImageAssessmentOutputs
from cdff_core.dfns.stereo_motion_estimation._interface import StereoMotionEstimationOutputs

Count = Annotated[int, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]


class Limits(StrictModel):
    """Limits of acceptance; FAILED below ``min``, DEGRADED below ``good``."""

    min_contrast_dn: Positive = 10.0  # twice the range that noise of 1 DN spans: less is a black or flat image
    max_saturation: Fraction = 0.5
    good_sharpness: Positive = 0.25  # blurred by 2 px or more, see BandEnergy
    good_sharpness_ratio: Fraction = 0.6  # to the key frame: a patch that lost the finest octave
    min_stereo: Count = 30
    good_stereo: Count = 80
    min_stereo_fraction: Fraction = 0.15  # of the detected points; two scenes agree by chance in a few per cent
    good_stereo_fraction: Fraction = 0.3
    min_pairing_fraction: Fraction = 0.4  # of the tracked points that have their disparity where the pose puts it
    min_inliers: Count = 15
    good_inliers: Count = 50
    good_inlier_fraction: Fraction = 0.4
    min_disparity_px: Positive = 1.0  # five times its noise; what is farther serves the rotation no better
    near_disparity_px: Positive = 10.0  # with 0.2 px noise a distance good to 2 %
    min_near: Count = 4
    good_near: Count = 12
    max_unit_variance: Positive = 9.0  # residuals three times the noise model's
    good_sigma_fraction: Positive = 0.1  # of the distance moved since the key frame, and not below good_sigma_m
    good_sigma_m: Positive = 0.05


def judge_images(left: ImageAssessmentOutputs, right: ImageAssessmentOutputs, limits: Limits) -> None:
    """Raise RefusedError on images that hold nothing: black, flat, saturated, or one of them frozen."""
    reasons = []
    for side, seen in (("left", left), ("right", right)):
        if seen.contrast[0] < limits.min_contrast_dn:
            reasons.append(f"low_contrast_{side}:{seen.contrast[0]:.0f}<{limits.min_contrast_dn:.0f}")
        if seen.saturation[0] > limits.max_saturation:
            reasons.append(f"saturated_{side}:{seen.saturation[0]:.2f}>{limits.max_saturation:.2f}")
    frozen = [side for side, seen in (("left", left), ("right", right)) if seen.change[0] == 0.0]
    if len(frozen) == 1:
        reasons.append(f"frozen_image:{frozen[0]}")
    if reasons:
        raise RefusedError("images cannot be used: " + ", ".join(reasons), reasons)


def blur_reasons(sharpness: float, reference: float | None, limits: Limits) -> list[str]:
    """``blurred`` where the finest octave is missing, absolutely or compared with the key frame."""
    least = limits.good_sharpness
    if reference is not None:
        least = max(least, limits.good_sharpness_ratio * reference)
    return [f"blurred:{sharpness:.2f}<{least:.2f}"] if sharpness < least else []


def judge_stereo(disparities: np.ndarray, detected: int, limits: Limits) -> list[str]:
    """Reasons for a doubtful key frame; raises RefusedError where left and right do not show the same."""
    matched, near = len(disparities), int((disparities >= limits.near_disparity_px).sum())
    fraction = matched / max(detected, 1)
    if matched < limits.min_stereo:
        raise RefusedError(f"{matched} stereo points", [f"few_stereo_points:{matched}<{limits.min_stereo}"])
    if fraction < limits.min_stereo_fraction:
        reason = f"stereo_mismatch:{fraction:.2f}<{limits.min_stereo_fraction:.2f}"
        raise RefusedError("left and right image do not match", [reason])
    reasons = []
    if matched < limits.good_stereo:
        reasons.append(f"few_stereo_points:{matched}<{limits.good_stereo}")
    if fraction < limits.good_stereo_fraction:
        reasons.append(f"stereo_mismatch:{fraction:.2f}<{limits.good_stereo_fraction:.2f}")
    if near < limits.good_near:
        reasons.append(f"few_near_points:{near}<{limits.good_near}")
    return reasons


def judge_motion(metrics: dict[str, float], limits: Limits) -> list[str]:
    """Reasons for a doubtful motion from its metrics; raises RefusedError where it cannot be stood for."""
    near, inliers = int(metrics["near_points"]), int(metrics["inliers"])
    if inliers < limits.min_inliers:
        raise RefusedError(f"{inliers} inliers", [f"few_inliers:{inliers}<{limits.min_inliers}"])
    if near < limits.min_near:
        raise RefusedError(f"{near} near points carry the translation", [f"few_near_points:{near}<{limits.min_near}"])
    if metrics["unit_variance"] > limits.max_unit_variance:
        reason = f"residuals:{metrics['unit_variance']:.1f}>{limits.max_unit_variance:.1f}"
        raise RefusedError("the points do not move as one rigid scene", [reason])
    reasons = []
    if inliers < limits.good_inliers:
        reasons.append(f"few_inliers:{inliers}<{limits.good_inliers}")
    if metrics["inlier_fraction"] < limits.good_inlier_fraction:
        reasons.append(f"inlier_fraction:{metrics['inlier_fraction']:.2f}<{limits.good_inlier_fraction:.2f}")
    if near < limits.good_near:
        reasons.append(f"few_near_points:{near}<{limits.good_near}")
    allowed = max(limits.good_sigma_m, limits.good_sigma_fraction * metrics["moved_m"])
    if metrics["sigma_translation_m"] > allowed:
        reasons.append(f"uncertain:{metrics['sigma_translation_m']:.3f}>{allowed:.3f}")
    return reasons


def motion_metrics(
    refined: StereoMotionEstimationOutputs, disparities: np.ndarray, counts: dict[str, int], limits: Limits
) -> dict[str, float]:
    """What is published of a motion: ``counts`` (features, visible, tracked), residuals, conditioning, sigmas."""
    inliers = int(refined.inliers.sum())
    return {name: float(count) for name, count in counts.items()} | {
        "inliers": float(inliers),
        "inlier_fraction": inliers / max(counts["tracked"], 1),
        "near_points": float((disparities[refined.inliers] >= limits.near_disparity_px).sum()),
        "rms_px": float(np.sqrt(np.mean(refined.residuals[refined.inliers] ** 2))),
        "unit_variance": float(refined.unit_variance[0]),
        "conditioning": float(refined.conditioning[0]),
        "moved_m": float(np.linalg.norm(refined.motion[:3, 3])),
        "sigma_translation_m": largest_sigma(refined.covariance[:3, :3]),
        "sigma_rotation_rad": largest_sigma(refined.covariance[3:, 3:]),
    }


def largest_sigma(covariance: np.ndarray) -> float:
    """Square root of the largest eigenvalue of a covariance block."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
