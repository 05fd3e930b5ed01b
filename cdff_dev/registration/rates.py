# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rates with their bounds, errors of poses against truth, and the consistency of stated covariances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.evaluate.record import spread


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of one attempt.

    Attributes
    ----------
    error_m, error_deg : float or None
        Distance of the translations and angle between the rotations; None where there was no answer.
    cpu_s : float
    """

    error_m: float | None
    error_deg: float | None
    cpu_s: float

    @property
    def answered(self) -> bool:
        """Whether a pose was given."""
        return self.error_m is not None

    def within(self, gate_m: float, gate_deg: float) -> bool:
        """Whether the pose is right."""
        return self.error_m is not None and self.error_m <= gate_m and (self.error_deg or 0.0) <= gate_deg


def trial(T: FloatArray | None, T_true: FloatArray, cpu_s: float) -> Trial:
    """Judge an answer by the truth."""
    return Trial(None, None, cpu_s) if T is None else Trial(*pose_errors(T, T_true), cpu_s)


def pose_errors(T: FloatArray, T_true: FloatArray) -> tuple[float, float]:
    """Distance of the translations, metres, and angle between the rotations, degrees."""
    angle = se3.rotation_angle(T[:3, :3] @ T_true[:3, :3].T)
    return float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])), float(np.degrees(angle))


def bounds(count: int, trials: int, digits: int = 5) -> list[float]:
    """Two-sided 95 % interval of a rate, Clopper and Pearson (1934), doi:10.1093/biomet/26.4.404."""
    from scipy.stats import beta

    low = float(beta.ppf(0.025, count, trials - count + 1)) if count else 0.0
    high = float(beta.ppf(0.975, count + 1, trials - count)) if count < trials else 1.0
    return [round(low, digits), round(high, digits)]


def interval(count: int, trials: int) -> dict[str, float]:
    """Rate with its ``bounds``."""
    low, high = bounds(count, trials, 4)
    return {"count": count, "trials": trials, "rate": round(count / trials, 4), "low": low, "high": high}


def summary(trials: Sequence[Trial], gate_m: float, gate_deg: float) -> dict[str, Any]:
    """Right and wrong answers with their intervals, errors of the right ones, CPU time."""
    right = [t for t in trials if t.within(gate_m, gate_deg)]
    answered = sum(t.answered for t in trials)
    figures: dict[str, Any] = {
        "right": interval(len(right), len(trials)),
        "wrong": interval(answered - len(right), len(trials)),
        "cpu_s": spread([t.cpu_s for t in trials]),
    }
    if right:
        figures |= {
            "error_m": spread([t.error_m or 0.0 for t in right], 5),
            "error_deg": spread([t.error_deg or 0.0 for t in right], 5),
        }
    return figures


def in_words(rate: Mapping[str, float]) -> str:
    """``3 of 20 (3-38 %)`` with the interval, for tables."""
    return f"{rate['count']} of {rate['trials']} ({100 * rate['low']:.1f}–{100 * rate['high']:.1f} %)"


def nees_band(trials: int, freedoms: int = 6) -> tuple[float, float]:
    """Two-sided 95 % band of the mean of so many squared normalised errors (Bar-Shalom et al. 2001, 5.4.2)."""
    from scipy.stats import chi2

    low, high = (float(chi2.ppf(p, trials * freedoms)) / trials for p in (0.025, 0.975))
    return low, high
