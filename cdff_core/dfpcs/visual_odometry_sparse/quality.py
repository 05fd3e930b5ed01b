# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Acceptance of keyframes and motions: refused below a minimum, DEGRADED below a good value."""

from __future__ import annotations

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry.se3 import FloatArray
from cdff_core.dfns.stereo_motion_estimation.interface import StereoMotionEstimationOutputs
from cdff_core.stereo_odometry.limits import below, require
from cdff_core.stereo_odometry.motion_hypotheses import MAX_AMBIGUITY, SelectedMotion

#: Number of points of a keyframe with a disparity: FAILED below the first, DEGRADED below the second.
MIN_STEREO, GOOD_STEREO = 30, 80
#: Fraction of the detected points with a disparity; in two different scenes it is a few per cent by chance.
MIN_STEREO_FRACTION, GOOD_STEREO_FRACTION = 0.15, 0.3
#: Fraction of the tracked points with the predicted disparity.
MIN_PAIRING_FRACTION = 0.4
#: Number of inliers of a motion, and their fraction of the tracked points.
MIN_INLIERS, GOOD_INLIERS, GOOD_INLIER_FRACTION = 15, 50, 0.4
#: Disparity of a usable point: five times its noise; more distant points add no information on the rotation.
MIN_DISPARITY_PX = 1.0
#: Disparity of a near point: with noise of 0.2 px its distance is accurate to 2 %.
NEAR_DISPARITY_PX = 10.0
#: Number of near points.
MIN_NEAR, GOOD_NEAR = 4, 12
#: Largest ratio of the area of lost points that hardly moved to the area of the found points; on a street it
#: reaches 0.11.
MAX_LOST_RATIO = 0.2
#: Variance of unit weight of the residuals: three times the standard deviation of the noise model.
MAX_UNIT_VARIANCE = 9.0
#: Standard deviation of a translation relative to the distance from the keyframe, and the least gate.
GOOD_SIGMA_FRACTION, GOOD_SIGMA_M = 0.1, 0.05


def stereo_reasons(disparities: FloatArray, detected: int) -> list[str]:
    """Return the deficiencies of a keyframe; raises RefusedError if left and right image do not match."""
    matched_count, near_count = len(disparities), int((disparities >= NEAR_DISPARITY_PX).sum())
    fraction = matched_count / max(detected, 1)
    require(matched_count, MIN_STEREO, "few_stereo_points")
    require(fraction, MIN_STEREO_FRACTION, "stereo_mismatch")
    return [
        *below(matched_count, GOOD_STEREO, "few_stereo_points"),
        *below(fraction, GOOD_STEREO_FRACTION, "stereo_mismatch"),
        *below(near_count, GOOD_NEAR, "few_near_points"),
    ]


def motion_reasons(metrics: dict[str, float]) -> list[str]:
    """Return the deficiencies of a motion from its metrics; raises RefusedError if it is unusable."""
    near_points, inliers = int(metrics["near_points"]), int(metrics["inliers"])
    require(inliers, MIN_INLIERS, "few_inliers")
    require(near_points, MIN_NEAR, "few_near_points")
    if metrics["unit_variance"] > MAX_UNIT_VARIANCE:
        reason = f"residuals:{metrics['unit_variance']:.1f}>{MAX_UNIT_VARIANCE:.1f}"
        raise RefusedError("the points do not move as one rigid scene", [reason])
    reasons = [
        *below(inliers, GOOD_INLIERS, "few_inliers"),
        *below(metrics["inlier_fraction"], GOOD_INLIER_FRACTION, "inlier_fraction"),
        *below(near_points, GOOD_NEAR, "few_near_points"),
    ]
    if metrics["ambiguity"] > MAX_AMBIGUITY:
        reasons.append(f"competing_motion:{metrics['ambiguity']:.2f}>{MAX_AMBIGUITY:.2f}")
    if metrics["lost_ratio"] > MAX_LOST_RATIO:
        reasons.append(f"lost_region:{metrics['lost_ratio']:.2f}>{MAX_LOST_RATIO:.2f}")
    if metrics["prior_ratio"] > 1.0:
        reasons.append(f"motion_prior:{metrics['prior_ratio']:.1f}>1.0")
    allowed = max(GOOD_SIGMA_M, GOOD_SIGMA_FRACTION * metrics["moved_m"])
    if metrics["sigma_translation_m"] > allowed:
        reasons.append(f"uncertain:{metrics['sigma_translation_m']:.3f}>{allowed:.3f}")
    return reasons


def is_scene_uncertain(metrics: dict[str, float]) -> bool:
    """Return whether the selected motion may be that of an object: then a new keyframe is made, in which all
    motions are visible again.
    """
    return metrics["ambiguity"] > MAX_AMBIGUITY or metrics["lost_ratio"] > MAX_LOST_RATIO


def motion_metrics(
    refined: StereoMotionEstimationOutputs, disparities: FloatArray, counts: dict[str, int]
) -> dict[str, float]:
    """Return the metrics of a motion; ``counts`` are the numbers of features, visible and tracked points."""
    inliers = int(refined.inliers.sum())
    return {name: float(count) for name, count in counts.items()} | {
        "inliers": float(inliers),
        "inlier_fraction": inliers / max(counts["tracked"] - counts["other_motion_points"], 1),
        "near_points": float((disparities[refined.inliers] >= NEAR_DISPARITY_PX).sum()),
        "rms_px": float(np.sqrt(np.mean(refined.residuals[refined.inliers] ** 2))),
        "unit_variance": refined.unit_variance,
        "conditioning": refined.conditioning,
        "moved_m": float(np.linalg.norm(refined.motion[:3, 3])),
        "sigma_translation_m": _largest_sigma(refined.covariance[:3, :3]),
        "sigma_rotation_rad": _largest_sigma(refined.covariance[3:, 3:]),
    }


def hypothesis_metrics(motion: SelectedMotion) -> dict[str, float]:
    """Return the metrics of the selection among competing motions."""
    return {
        "hypotheses": float(1 + len(motion.others)),
        "coverage": motion.scene.coverage,
        "other_coverage": max((other.coverage for other in motion.others), default=0.0),
        "ambiguity": motion.ambiguity,
        "prior_ratio": motion.prior_ratio,
    }


def _largest_sigma(covariance: FloatArray) -> float:
    """Return the largest standard deviation in any direction."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
