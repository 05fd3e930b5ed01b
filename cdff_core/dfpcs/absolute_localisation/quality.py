# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Acceptance of the best hypothesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_core.dfpcs.absolute_localisation.hypotheses import Hypothesis, probability

#: Minimum probability of the best hypothesis, fraction of the relief explained, and correlation of gradients.
_MIN_PROBABILITY, _MIN_EXPLAINED, _GOOD_EXPLAINED, _MIN_CORRELATION = 0.999, 0.45, 0.6, 0.52
#: Factor on the minima of explained relief and correlation if an earlier segment agrees.
_CONFIRMED_RATIO = 0.7
#: Largest standard deviation of the position, in cells of the orbital model.
_MAX_SIGMA_CELLS = 0.4


def assess(
    hypotheses: Sequence[Hypothesis], cell_m: float, metrics: Mapping[str, float], kind: CovarianceKind
) -> Quality:
    """Return the quality of the first hypothesis; FAILED if it is ambiguous, unexplained or uncertain."""
    best, p = hypotheses[0], probability(hypotheses)
    ratio = _CONFIRMED_RATIO if best.matches > 1 else 1.0
    failures, deficiencies = [], []
    if not best.explained:
        failures.append("no_candidate_agrees")
    if p < _MIN_PROBABILITY:
        failures.append(f"ambiguous:{p:.3f}")
    if best.explained < ratio * _MIN_EXPLAINED:
        failures.append(f"unexplained:{best.explained:.2f}")
    elif best.explained < ratio * _GOOD_EXPLAINED:
        deficiencies.append(f"weakly_explained:{best.explained:.2f}")
    if best.correlation < ratio * _MIN_CORRELATION:
        failures.append(f"low_correlation:{best.correlation:.2f}")
    if best.sigma_m > _MAX_SIGMA_CELLS * cell_m:
        failures.append(f"uncertain:{best.sigma_m:.2f}m")
    status = Status.FAILED if failures else Status.DEGRADED if deficiencies else Status.OK
    return Quality(
        status,
        tuple(failures or deficiencies),
        kind,
        {**metrics, "probability": p, "matches": best.matches, "sigma_m": best.sigma_m},
    )
