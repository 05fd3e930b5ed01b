# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rates with their confidence intervals, errors of poses, and the consistency of stated covariances."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray


def pose_errors(T: FloatArray, T_true: FloatArray) -> tuple[float, float]:
    """Return the distance between the translations, metres, and the angle between the rotations, degrees."""
    angle = se3.rotation_angle(T[:3, :3] @ T_true[:3, :3].T)
    return float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])), float(np.degrees(angle))


def bounds(count: int, trials: int, digits: int = 5) -> list[float]:
    """Return the 95 % interval of a rate, Clopper and Pearson (1934), doi:10.1093/biomet/26.4.404."""
    from scipy.stats import beta

    low = float(beta.ppf(0.025, count, trials - count + 1)) if count else 0.0
    high = float(beta.ppf(0.975, count + 1, trials - count)) if count < trials else 1.0
    return [round(low, digits), round(high, digits)]


def interval(count: int, trials: int) -> dict[str, float]:
    """Return count, trials, rate, and the 95 % interval of the rate (``low``, ``high``)."""
    low, high = bounds(count, trials, 4)
    return {"count": count, "trials": trials, "rate": round(count / trials, 4), "low": low, "high": high}


def rate_text(rate: Mapping[str, float]) -> str:
    """Return a rate with its interval for tables: ``3 of 20 (3.2–37.9 %)``."""
    return f"{rate['count']} of {rate['trials']} ({100 * rate['low']:.1f}–{100 * rate['high']:.1f} %)"


def nees_band(trials: int, freedoms: int = 6) -> tuple[float, float]:
    """Return the two-sided 95 % band of the mean NEES of independent trials.

    Bar-Shalom et al. (2001), doi:10.1002/0471221279, section 5.4.2.
    """
    from scipy.stats import chi2

    low, high = (float(chi2.ppf(p, trials * freedoms)) / trials for p in (0.025, 0.975))
    return low, high
