# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assessment of stored products against a request, and selection of the best one.

Type, frame, age and coverage are mandatory if requested. Resolution, accuracy and the age of the oldest part
are optional: coarser or less accurate data are delivered, and the reply states the difference. DEGRADED
products are delivered with their reasons, FAILED ones never.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from cdff_common.clock import NS_PER_S
from cdff_core.orchestration.accuracy import Accuracy
from cdff_core.orchestration.request import ProductRequest

#: Ratio up to which two resolutions count as equal.
RESOLUTION_TOLERANCE = 1.001
#: Coverage above which a region counts as covered.
_FULL_COVERAGE = 0.9995
#: Largest lead of a capture over the mission clock, seconds; more means an earlier run of the same log.
AHEAD_TOLERANCE_S = 2.0
#: Lead that is stated in a reply, seconds: below it, clocks agree.
_AHEAD_REMARK_S = 0.05


@dataclass(frozen=True, slots=True)
class ProductCandidate:
    """Metadata of a stored product, or of a window fused from several, that may answer a request."""

    id: str
    robot: str
    t1_ns: int  # end of capture of the newest part
    oldest_t1_ns: int  # end of capture of the oldest part
    resolution_m: float | None = None
    coverage: float | None = None  # fraction of the region that holds data, 0 to 1; None without a region
    status: str = "OK"  # OK, DEGRADED or FAILED
    accuracy: Accuracy | None = None  # set if the request has bounds on it

    def age_s(self, now_ns: int) -> float:
        """Return the age of the newest part, seconds; negative for a capture ahead of the clock."""
        return (now_ns - self.t1_ns) / NS_PER_S

    def oldest_age_s(self, now_ns: int) -> float:
        """Return the age of the oldest part, seconds; negative for a capture ahead of the clock."""
        return (now_ns - self.oldest_t1_ns) / NS_PER_S

    def unmet_bounds(self, request: ProductRequest, now_ns: int) -> tuple[str, ...]:
        """Return the unmet bounds on accuracy and age of the oldest part, as texts."""
        texts: tuple[str, ...] = ()
        if request.accuracy.is_set:
            texts = request.accuracy.unmet(self.accuracy or Accuracy(status=self.status))
        oldest_age_s = self.oldest_age_s(now_ns)
        if oldest_age_s > request.max_oldest_age_s:
            limit_s = request.max_oldest_age_s
            texts += (f"oldest_age: {oldest_age_s:.3f} s, asked at most {limit_s:g} s",)
        return texts


@dataclass(frozen=True, slots=True)
class Assessment:
    """Differences between a candidate and a request, as texts."""

    #: Unmet mandatory requirements; the candidate may be delivered if there are none.
    violations: tuple[str, ...] = ()
    #: Unmet optional requirements that a new product may meet; stated in the reply.
    shortfalls: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()  # differences that no new product would remove; stated in the reply
    #: Unmet optional bounds on accuracy and age of the oldest part, which any later product may meet.
    bounds: tuple[str, ...] = ()

    @property
    def differences(self) -> list[str]:
        """All differences."""
        return [*self.violations, *self.shortfalls, *self.bounds, *self.remarks]

    @property
    def unmet(self) -> str:
        """Unmet requirements that a new product may meet, as one line."""
        return "; ".join([*self.violations, *self.shortfalls, *self.bounds])

    @property
    def satisfies(self) -> bool:
        """True if a new product would not meet the request better."""
        return not self.violations and not self.shortfalls and not self.bounds

    @property
    def acceptable(self) -> bool:
        """True if all mandatory requirements are met."""
        return not self.violations


def assess(candidate: ProductCandidate, request: ProductRequest, now_ns: int) -> Assessment:
    """Compare a candidate with a request at mission time ``now_ns``, or at the requested time."""
    violations, shortfalls, remarks = [], [], []
    # A pose at a requested time is interpolated: its age does not matter.
    is_timed = request.t_ns is None or request.product != "pose"
    if request.t_ns is not None and is_timed:
        now_ns = request.t_ns
    if candidate.status == "FAILED":
        violations.append("status: FAILED")
    if candidate.status == "DEGRADED" and request.accuracy.status is None:
        remarks.append("status: DEGRADED, see its quality")
    age_s = candidate.age_s(now_ns)
    ahead_s = (candidate.t1_ns - now_ns) / NS_PER_S
    if is_timed and ahead_s > AHEAD_TOLERANCE_S:
        violations.append(f"time: captured {ahead_s:.3f} s ahead of the mission clock")
    elif request.t_ns is None and ahead_s > _AHEAD_REMARK_S:
        remarks.append(f"time: ahead of the mission clock by {ahead_s:.3f} s; the clock of a sensor is wrong")
    if request.window_ns is not None and not request.window_ns[0] <= candidate.t1_ns <= request.window_ns[1]:
        violations.append("time: captured outside of the requested window")
    if is_timed and age_s > request.max_age_s:
        violations.append(f"age: {age_s:.3f} s old, asked at most {request.max_age_s:g} s")
    if request.region is not None and candidate.coverage is not None:
        if candidate.coverage <= 0.0:
            violations.append("coverage: nothing in the region")
        elif candidate.coverage < request.min_coverage:
            violations.append(f"coverage: {candidate.coverage:.3f}, asked at least {request.min_coverage:g}")
        elif candidate.coverage < _FULL_COVERAGE and not request.min_coverage:
            remarks.append(f"coverage: {candidate.coverage:.3f} of the region holds data")
    requested_m, actual_m = request.resolution_m, candidate.resolution_m
    if requested_m is not None and actual_m is not None:
        difference = f"resolution: {actual_m:g} m, asked {requested_m:g} m"
        if actual_m > requested_m * RESOLUTION_TOLERANCE:
            shortfalls.append(difference)
        elif actual_m * RESOLUTION_TOLERANCE < requested_m:
            remarks.append(f"{difference}, which is not a multiple of the finer cells")
    return Assessment(
        tuple(violations), tuple(shortfalls), tuple(remarks), candidate.unmet_bounds(request, now_ns)
    )


def _preference(assessed: tuple[ProductCandidate, Assessment]) -> tuple[object, ...]:
    """Return the key by which candidates are compared, the best one first."""
    candidate, assessment = assessed
    return (
        len(assessment.violations),
        len(assessment.shortfalls) + len(assessment.bounds),
        -(candidate.coverage or 0.0),
        -candidate.t1_ns,
        candidate.id,
    )


def best_candidate(
    candidates: Iterable[ProductCandidate], request: ProductRequest, now_ns: int
) -> tuple[ProductCandidate, Assessment] | None:
    """Return the candidate with fewest violations, fewest other differences, largest coverage, lowest age."""
    return min(
        ((candidate, assess(candidate, request, now_ns)) for candidate in candidates),
        key=_preference,
        default=None,
    )


def delivery_summary(
    candidate: ProductCandidate, assessment: Assessment, now_ns: int, frame: str
) -> dict[str, object]:
    """Return the ``delivered`` map of a reply: properties of the product and differences from the request."""
    return {
        "robot": candidate.robot,
        "frame": frame,
        "resolution_m": candidate.resolution_m,
        "coverage": candidate.coverage,
        "age_s": round(candidate.age_s(now_ns), 6),
        "oldest_age_s": round(candidate.oldest_age_s(now_ns), 6),
        "status": candidate.status,
        "differences": assessment.differences,
        **_accuracy_fields(candidate.accuracy),
    }


def _accuracy_fields(accuracy: Accuracy | None) -> dict[str, object]:
    """Return the standard deviations of a reply; none if the request did not ask for them."""
    if accuracy is None:
        return {}
    kind = str(accuracy.covariance_kind)
    return {"sigma_m": accuracy.sigma_m, "sigma_deg": accuracy.sigma_deg, "covariance_kind": kind}
