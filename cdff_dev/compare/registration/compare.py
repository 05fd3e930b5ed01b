# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of estimated poses between clouds with the true ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry.covariance import pose_error
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import interval, nees_band, pose_errors
from cdff_dev.compare.registration.read import Pair

_COUNTS = ("keypoints_source", "keypoints_target", "matches", "match_inliers", "clique", "overlap_source")


def compare(
    estimate: Mapping[str, Pair], truth: Mapping[str, Pair], gates: Sequence[tuple[float, float]]
) -> dict[str, Any]:
    """Return the accuracy of estimated poses.

    Parameters
    ----------
    estimate, truth : mapping of str to Pair
        Poses by the name of their pair. A pair without a true pose has no correct pose: any estimate of it
        is a false accept.
    gates : sequence of (float, float)
        Largest errors of a correct pose, metres and degrees.

    Returns
    -------
    dict
        ``pairs``, ``answered`` and ``refused``; for each gate the recall and the fraction of wrong estimates
        over the pairs with a true pose; ``false_accepts`` over the other pairs; errors of the estimates with
        a true pose; ``nees`` with the 95 % band of its mean; ``counts``: medians of the numbers of matches in
        the metrics of the estimate. Rates have Clopper-Pearson intervals.

    Raises
    ------
    InputError
        If the estimate has a pair that is not in the truth.
    """
    unknown = [name for name in estimate if name not in truth]
    if unknown:
        raise InputError(
            f"estimate: pair {unknown[0]!r} is not in the truth, which has {', '.join(list(truth)[:5])}…"
        )
    answers = {name: pair.T for name, pair in estimate.items() if pair.T is not None}
    true_poses = {name: pair.T for name, pair in truth.items() if pair.T is not None}
    compared = [name for name in true_poses if name in answers]
    errors = {name: pose_errors(answers[name].matrix, true_poses[name].matrix) for name in compared}
    results: dict[str, Any] = {
        "pairs": len(truth),
        "answered": len(answers),
        "refused": len(truth) - len(answers),
    }
    for metres, degrees in gates if true_poses else ():
        correct = sum(m <= metres and d <= degrees for m, d in errors.values())
        results[f"within_{metres:g}_m_{degrees:g}_deg"] = {
            "recall": interval(correct, len(true_poses)),
            "wrong": interval(len(compared) - correct, len(true_poses)),
        }
    if len(true_poses) < len(truth):
        without_truth = [name for name in truth if name not in true_poses]
        results["false_accepts"] = interval(
            sum(name in answers for name in without_truth), len(without_truth)
        )
    results["error_m"] = error_summary([m for m, _ in errors.values()], 6)
    results["error_deg"] = error_summary([d for _, d in errors.values()], 6)
    results["nees"] = _nees(compared, answers, true_poses)
    metrics = [estimate[name].metrics for name in estimate]
    results["counts"] = {
        key: float(np.median([m[key] for m in metrics if key in m]))
        for key in _COUNTS
        if any(key in m for m in metrics)
    }
    return results


def _nees(
    compared: Sequence[str], answers: Mapping[str, Any], true_poses: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the mean NEES (expected: 6) with its 95 % band, and the mean stated sigma of the translation."""
    with_covariance = [name for name in compared if answers[name].covariance is not None]
    if not with_covariance:
        return {"count": 0}
    values, sigmas = [], []
    for name in with_covariance:
        T = answers[name]
        e = pose_error(true_poses[name].matrix, T.matrix)
        values.append(float(e @ np.linalg.solve(T.covariance, e)))
        sigmas.append(float(np.sqrt(np.mean(np.diag(T.covariance)[:3]))))
    low, high = nees_band(len(values))
    return {
        "count": len(values),
        "mean": float(np.mean(values)),
        "band": [round(low, 3), round(high, 3)],
        "inside": low <= float(np.mean(values)) <= high,
        "mean_sigma_m": float(np.mean(sigmas)),
    }


def table(results: Mapping[str, Any]) -> str:
    """Return the results as text for a terminal."""
    lines = [f"pairs {results['pairs']}, answered {results['answered']}, refused {results['refused']}"]
    for key, value in results.items():
        if key.startswith("within_"):
            gate = key.removeprefix("within_").replace("_deg", "°").replace("_m_", " m, ")
            lines.append(
                f"within {gate}: correct {_rate_line(value['recall'])}; wrong {_rate_line(value['wrong'])}"
            )
    if "false_accepts" in results:
        lines.append(f"false accepts: {_rate_line(results['false_accepts'])}")
    for key, unit in (("error_m", "m"), ("error_deg", "°")):
        summary = results[key]
        if summary["count"]:
            median, p95, largest = (summary[name] for name in ("median", "p95", "max"))
            lines.append(
                f"error: median {median:.4g} {unit}, 95 % {p95:.4g} {unit}, at most {largest:.4g} {unit}"
            )
    nees = results["nees"]
    if nees["count"]:
        position = "inside" if nees["inside"] else "outside"
        low, high = nees["band"]
        lines.append(
            f"NEES: mean {nees['mean']:.3g} of {nees['count']}, {position} the 95 % band "
            f"{low:g} to {high:g}; mean sigma {nees['mean_sigma_m']:.3g} m"
        )
    if results["counts"]:
        lines.append("medians: " + ", ".join(f"{key} {value:g}" for key, value in results["counts"].items()))
    return "\n".join(lines)


def _rate_line(rate: Mapping[str, float]) -> str:
    percent, low, high = (100.0 * rate[key] for key in ("rate", "low", "high"))
    return f"{rate['count']} of {rate['trials']} ({percent:.1f} %; 95 %: {low:.1f} to {high:.1f} %)"
