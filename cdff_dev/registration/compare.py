# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of pairs of clouds against their truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry.covariance import pose_error
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import interval, nees_band, pose_errors
from cdff_dev.registration.read import Pair

_COUNTS = ("keypoints_source", "keypoints_target", "matches", "match_inliers", "clique", "overlap_source")


def compare(
    estimate: Mapping[str, Pair], truth: Mapping[str, Pair], gates: Sequence[tuple[float, float]]
) -> dict[str, Any]:
    """Figures of an estimate.

    Parameters
    ----------
    estimate, truth : mapping of str to Pair
        By pair; a pair without a pose in the truth has no answer, and any answer to it is a false accept.
    gates : sequence of (float, float)
        Metres and degrees within which a pose is right.

    Returns
    -------
    dict
        pairs, answered, refused; for each gate the recall over the pairs that have an answer, and the wrong among the
        answered; false_accepts over those that have none; errors of all answers; nees with its 95 % band for as many
        trials; medians of the counts of matches that the estimate states. Rates carry Clopper-Pearson intervals.

    Raises
    ------
    InputError
        If the estimate names a pair that the truth does not know.
    """
    unknown = [name for name in estimate if name not in truth]
    if unknown:
        raise InputError(f"estimate: pair {unknown[0]!r} is not in the truth, which has {', '.join(list(truth)[:5])}…")
    answers = {name: pair.T for name, pair in estimate.items() if pair.T is not None}
    there = {name: pair.T for name, pair in truth.items() if pair.T is not None}
    both = [name for name in there if name in answers]
    errors = {name: pose_errors(answers[name].matrix, there[name].matrix) for name in both}
    figures: dict[str, Any] = {"pairs": len(truth), "answered": len(answers), "refused": len(truth) - len(answers)}
    for metres, degrees in gates if there else ():
        right = sum(m <= metres and d <= degrees for m, d in errors.values())
        figures[f"within_{metres:g}_m_{degrees:g}_deg"] = {
            "recall": interval(right, len(there)), "wrong": interval(len(both) - right, len(there))
        }  # fmt: skip
    if len(there) < len(truth):
        none = [name for name in truth if name not in there]
        figures["false_accepts"] = interval(sum(name in answers for name in none), len(none))
    figures["error_m"] = spread([m for m, _ in errors.values()], 6)
    figures["error_deg"] = spread([d for _, d in errors.values()], 6)
    figures["nees"] = _nees(both, answers, there)
    stated = [estimate[name].metrics for name in estimate]
    figures["counts"] = {
        key: float(np.median([m[key] for m in stated if key in m])) for key in _COUNTS if any(key in m for m in stated)
    }
    return figures


def _nees(both: Sequence[str], answers: Mapping[str, Any], there: Mapping[str, Any]) -> dict[str, Any]:
    """Mean squared normalised error (6 expected) with its band, and the mean stated sigma of a translation."""
    with_covariance = [name for name in both if answers[name].covariance is not None]
    if not with_covariance:
        return {"count": 0}
    values, sigmas = [], []
    for name in with_covariance:
        T = answers[name]
        e = pose_error(there[name].matrix, T.matrix)
        values.append(float(e @ np.linalg.solve(T.covariance, e)))
        sigmas.append(float(np.sqrt(np.mean(np.diag(T.covariance)[:3]))))
    low, high = nees_band(len(values))
    return {
        "count": len(values), "mean": float(np.mean(values)), "band": [round(low, 3), round(high, 3)],
        "inside": low <= float(np.mean(values)) <= high, "mean_sigma_m": float(np.mean(sigmas)),
    }  # fmt: skip


def table(figures: Mapping[str, Any]) -> str:
    """The figures as lines a person reads."""
    lines = [f"pairs {figures['pairs']}, answered {figures['answered']}, refused {figures['refused']}"]
    for key, value in figures.items():
        if key.startswith("within_"):
            gate = key.removeprefix("within_").replace("_deg", "°").replace("_m_", " m, ")
            lines.append(f"within {gate}: right {_rate(value['recall'])}; wrong {_rate(value['wrong'])}")
    if "false_accepts" in figures:
        lines.append(f"false accepts: {_rate(figures['false_accepts'])}")
    for key, unit in (("error_m", "m"), ("error_deg", "°")):
        spread_ = figures[key]
        if spread_["count"]:
            median, p95, most = (spread_[name] for name in ("median", "p95", "max"))
            lines.append(f"error: median {median:.4g} {unit}, 95 % {p95:.4g} {unit}, at most {most:.4g} {unit}")
    nees = figures["nees"]
    if nees["count"]:
        verdict = "inside" if nees["inside"] else "outside"
        low, high = nees["band"]
        lines.append(
            f"normalised squared error: mean {nees['mean']:.3g} of {nees['count']}, {verdict} the 95 % band "
            f"{low:g} to {high:g}; mean sigma {nees['mean_sigma_m']:.3g} m"
        )
    if figures["counts"]:
        lines.append("medians: " + ", ".join(f"{key} {value:g}" for key, value in figures["counts"].items()))
    return "\n".join(lines)


def _rate(rate: Mapping[str, float]) -> str:
    share, low, high = (100.0 * rate[key] for key in ("rate", "low", "high"))
    return f"{rate['count']} of {rate['trials']} ({share:.1f} %; 95 %: {low:.1f} to {high:.1f} %)"
