# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Whether an alignment found without a guess can be stood for."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_core.cloud_matching.matcher import Found

_TANGENT = ("translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z")


class Gates(Protocol):
    """Bounds that a configuration holds."""

    min_overlap: float
    good_overlap: float
    min_inlier_ratio: float
    max_rms_gates: float
    min_agreement: float
    good_agreement: float
    max_chance: float


def judged(found: Found, overlap: float, gates: Gates) -> Quality:
    """Return FAILED, DEGRADED or OK, with the reasons and what they rest on.

    Parameters
    ----------
    found : Found
    overlap : float
        The share of points with a neighbour in the other cloud that counts here.
    gates : Gates
    """
    a = found.assessment
    failed, degraded = [], []
    if overlap < gates.min_overlap:
        failed.append(f"low_overlap:{overlap:.2f}<{gates.min_overlap:g}")
    elif overlap < gates.good_overlap:
        degraded.append(f"low_overlap:{overlap:.2f}<{gates.good_overlap:g}")
    if float(a.inlier_ratio) < gates.min_inlier_ratio:
        failed.append(f"few_inliers:{float(a.inlier_ratio):.2f}<{gates.min_inlier_ratio:g}")
    if float(a.rms_m) > gates.max_rms_gates * float(a.gate_m):
        failed.append(f"large_residuals:{float(a.rms_m):.3g}m")
    chance = found.metrics.get("expected_by_chance", 0.0)
    if chance > gates.max_chance:
        failed.append(f"matches_by_chance:{chance:.1g}>{gates.max_chance:g}")
    failed += [f"degenerate:{name}" for name in _named(a.directions[a.agreement < gates.min_agreement])]
    weak = (a.agreement >= gates.min_agreement) & (a.agreement < gates.good_agreement)
    degraded += [f"weak:{name}" for name in _named(a.directions[weak])]
    if not found.converged:
        degraded.append("not_converged")
    status = Status.FAILED if failed else Status.DEGRADED if degraded else Status.OK
    kind = CovarianceKind.NONE if failed else CovarianceKind.FORMAL
    return Quality(status, tuple(failed + degraded), kind, found.metrics | _metrics(found))


def refused(meaning: str, reasons: tuple[str, ...]) -> Quality:
    """FAILED: what it means to the user, then what spoke against the best candidate."""
    return Quality(Status.FAILED, (meaning, *(r for r in reasons if r != meaning)))


def _named(directions: NDArray[np.float64]) -> list[str]:
    """The component that is largest in each direction, without repetition."""
    return list(dict.fromkeys(_TANGENT[int(np.argmax(np.abs(d)))] for d in directions))


def _metrics(found: Found) -> dict[str, float]:
    a = found.assessment
    return {
        "overlap_source": float(a.overlap_source),
        "overlap_target": float(a.overlap_target),
        "inlier_ratio": float(a.inlier_ratio),
        "rms_m": float(a.rms_m),
        "gate_m": float(a.gate_m),
        "condition_number": float(a.information[-1] / a.information[0]),
        "least_agreement": float(a.agreement.min()),
        "refinement_m": found.moved_m,
    }
