# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a product answers a request, what is missing, and which of several is best.

Type, frame, age and coverage are mandatory where asked; resolution is a wish (contract §7: coarser data are delivered
as they are and the answer says so). DEGRADED products are delivered with their reasons, FAILED ones never.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from cdff_common.clock import NS_PER_S
from cdff_core.orchestration.request import ProductRequest

#: A resolution within this factor of the asked one counts as what was asked.
RESOLUTION_TOLERANCE = 1.001
#: Coverage from which a region counts as covered.
_ALL_COVERED = 0.9995
#: A capture further ahead of the mission clock than this, seconds, is of an earlier run of the same log.
AHEAD_TOLERANCE_S = 2.0


@dataclass(frozen=True, slots=True)
class Candidate:
    """A product, or a window fused from several, as a possible answer.

    Attributes
    ----------
    id : str
    robot : str
    t1_ns : int
        End of capture; of the newest part where there are several.
    oldest_t1_ns : int
        End of capture of the oldest part.
    resolution_m : float or None
    coverage : float or None
        Part of the region that holds data, 0 to 1; None where no region was asked.
    status : str
        OK, DEGRADED or FAILED.
    """

    id: str
    robot: str
    t1_ns: int
    oldest_t1_ns: int
    resolution_m: float | None = None
    coverage: float | None = None
    status: str = "OK"

    def age_s(self, now_ns: int) -> float:
        """Mission now minus end of capture of the newest part, seconds; 0 for captures that lie ahead of the clock."""
        return max(now_ns - self.t1_ns, 0) / NS_PER_S

    def oldest_age_s(self, now_ns: int) -> float:
        """The same of the oldest part."""
        return max(now_ns - self.oldest_t1_ns, 0) / NS_PER_S


@dataclass(frozen=True, slots=True)
class Judgement:
    """What a candidate lacks.

    Attributes
    ----------
    missing : tuple of str
        Mandatory wishes that are not met; empty means that it may be delivered.
    short : tuple of str
        Other wishes that are not met: worth waiting for, and stated in the answer.
    noted : tuple of str
        What is other than asked and will not come otherwise: only stated in the answer.
    """

    missing: tuple[str, ...] = ()
    short: tuple[str, ...] = ()
    noted: tuple[str, ...] = ()

    @property
    def differences(self) -> list[str]:
        """Everything that is not as asked."""
        return [*self.missing, *self.short, *self.noted]

    @property
    def satisfies(self) -> bool:
        """Nothing better is worth waiting for."""
        return not self.missing and not self.short

    @property
    def acceptable(self) -> bool:
        """All that is mandatory is as asked."""
        return not self.missing


def judge(candidate: Candidate, request: ProductRequest, now_ns: int) -> Judgement:
    """Compare a candidate with a request at mission time ``now_ns``, or at the time it asks for."""
    missing, short, noted = [], [], []
    if request.t_ns is not None and request.product != "pose":
        now_ns = request.t_ns
    if candidate.status == "FAILED":
        missing.append("status: FAILED")
    if candidate.status == "DEGRADED":
        noted.append("status: DEGRADED, as its quality says")
    age_s = candidate.age_s(now_ns)
    ahead_s = (candidate.t1_ns - now_ns) / NS_PER_S
    timed = request.t_ns is None or request.product != "pose"
    if timed and ahead_s > AHEAD_TOLERANCE_S:
        missing.append(f"time: captured {ahead_s:.3f} s ahead of the mission clock")
    if timed and age_s > request.max_age_s:
        missing.append(f"age: {age_s:.3f} s old, asked at most {request.max_age_s:g} s")
    if request.region is not None and candidate.coverage is not None:
        if candidate.coverage <= 0.0:
            missing.append("coverage: nothing in the region")
        elif candidate.coverage < request.min_coverage:
            missing.append(f"coverage: {candidate.coverage:.3f}, asked at least {request.min_coverage:g}")
        elif candidate.coverage < _ALL_COVERED and not request.min_coverage:
            noted.append(f"coverage: {candidate.coverage:.3f} of the region holds data")
    wanted_m, given_m = request.resolution_m, candidate.resolution_m
    if wanted_m is not None and given_m is not None and given_m > wanted_m * RESOLUTION_TOLERANCE:
        short.append(f"resolution: {given_m:g} m, asked {wanted_m:g} m")
    if wanted_m is not None and given_m is not None and given_m * RESOLUTION_TOLERANCE < wanted_m:
        noted.append(f"resolution: {given_m:g} m, asked {wanted_m:g} m: the finer cells do not add up to it")
    return Judgement(tuple(missing), tuple(short), tuple(noted))


def best(candidates: Iterable[Candidate], request: ProductRequest, now_ns: int) -> tuple[Candidate, Judgement] | None:
    """The candidate that lacks least: fewest mandatory faults, then fewest others, then coverage, then youth."""
    judged = [(c, judge(c, request, now_ns)) for c in candidates]
    if not judged:
        return None
    return min(
        judged, key=lambda cj: (len(cj[1].missing), len(cj[1].short), -(cj[0].coverage or 0.0), -cj[0].t1_ns, cj[0].id)
    )


def delivered(
    candidate: Candidate, judgement: Judgement, request: ProductRequest, now_ns: int, frame: str
) -> dict[str, object]:
    """The ``delivered`` map of an answer: what was given, and how it differs from what was asked."""
    return {
        "robot": candidate.robot,
        "frame": frame,
        "resolution_m": candidate.resolution_m,
        "coverage": candidate.coverage,
        "age_s": round(candidate.age_s(now_ns), 6),
        "oldest_age_s": round(candidate.oldest_age_s(now_ns), 6),
        "status": candidate.status,
        "differences": judgement.differences,
    }
