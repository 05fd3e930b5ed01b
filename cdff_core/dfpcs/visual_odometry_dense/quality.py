# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Acceptance of keyframes and alignments: refused below a minimum, DEGRADED below a good value."""

from __future__ import annotations

import numpy as np

from cdff_core.dfns.photometric_motion_estimation.interface import PhotometricMotionEstimationOutputs
from cdff_core.stereo_odometry.limits import below, require

#: Fraction of the pixels of a keyframe with a disparity. Matches by chance cover a few per cent.
MIN_STEREO_FRACTION, GOOD_STEREO_FRACTION = 0.1, 0.25
#: Correlation of the grey levels with the left and the right current image; the limits are not evaluated yet.
MIN_CORRELATION, GOOD_CORRELATION = 0.45, 0.6
#: Fraction of the pixels of the keyframe in view.
MIN_OVERLAP, GOOD_OVERLAP = 0.25, 0.4
#: Standard deviation of a translation relative to the distance from the keyframe, and the least gate.
GOOD_SIGMA_FRACTION, GOOD_SIGMA_M = 0.1, 0.05


def stereo_reasons(fraction: float) -> list[str]:
    """Return the deficiencies of a keyframe; raises RefusedError if left and right image do not match."""
    require(fraction, MIN_STEREO_FRACTION, "stereo_mismatch")
    return below(fraction, GOOD_STEREO_FRACTION, "stereo_mismatch")


def check_alignment(aligned: PhotometricMotionEstimationOutputs) -> None:
    """Raise RefusedError if the images do not agree at the estimated motion."""
    require(aligned.overlap, MIN_OVERLAP, "low_overlap")
    require(aligned.correlation, MIN_CORRELATION, "low_correlation")
    require(aligned.correlation_right, MIN_CORRELATION, "stereo_mismatch")


def alignment_reasons(metrics: dict[str, float]) -> list[str]:
    """Return the deficiencies of an accepted alignment from its metrics."""
    reasons = [
        *below(metrics["overlap"], GOOD_OVERLAP, "low_overlap"),
        *below(metrics["correlation"], GOOD_CORRELATION, "low_correlation"),
        *below(metrics["correlation_right"], GOOD_CORRELATION, "stereo_mismatch"),
    ]
    allowed = max(GOOD_SIGMA_M, GOOD_SIGMA_FRACTION * metrics["moved_m"])
    if metrics["sigma_translation_m"] > allowed:
        reasons.append(f"uncertain:{metrics['sigma_translation_m']:.3f}>{allowed:.3f}")
    if metrics["prior_ratio"] > 1.0:
        reasons.append(f"motion_prior:{metrics['prior_ratio']:.1f}>1.0")
    return reasons


def alignment_metrics(aligned: PhotometricMotionEstimationOutputs) -> dict[str, float]:
    """Return the metrics of an alignment."""
    covariance = aligned.covariance
    return {
        "pixels": float(aligned.pixels),
        "overlap": aligned.overlap,
        "correlation": aligned.correlation,
        "correlation_right": aligned.correlation_right,
        "inlier_fraction": aligned.inlier_fraction,
        "moved_px": aligned.moved,
        "conditioning": aligned.conditioning,
        "moved_m": float(np.linalg.norm(aligned.motion[:3, 3])),
        "sigma_translation_m": float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])),
        "sigma_rotation_rad": float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1])),
    }
