# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Planning and explanation of a request."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from cdff_common.bus import Reply
from cdff_common.clock import Clock
from cdff_common.errors import CdffError, DeadlineError, FrameNotFoundError, UnavailableError
from cdff_core.orchestration.acceptance import RESOLUTION_TOLERANCE, delivery_summary
from cdff_core.orchestration.accuracy import Accuracy
from cdff_core.orchestration.adjustment import settings_for
from cdff_core.orchestration.catalogue import frames_of
from cdff_core.orchestration.coverage import RegionCoverage, plan_coverage
from cdff_core.orchestration.explanation import explain, plan_with_costs
from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.request import ProductRequest
from cdff_core.orchestration.world import ProviderId, World
from services.orchestrator.product_finder import ProductFinder, ProductMatch
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Measured, else described accuracy of each implementation of the DFPCs of a product.
Accuracies: TypeAlias = "dict[tuple[ProviderId, str], Accuracy]"


@dataclass(frozen=True, slots=True)
class _Plans:
    """Plans for a request: with the DFPCs that run now, and with those that can be restarted."""

    world: World
    now: Plan | NoPlan
    optimistic_world: World
    later: Plan | NoPlan
    coverage: RegionCoverage | None
    accuracies: Accuracies


@dataclass(frozen=True, slots=True)
class RequestPlanner:
    """Planner of requests over the system state and the products in the DPM."""

    state: SystemState
    finder: ProductFinder
    clock: Clock
    timing: Timing = REAL

    def robots(self, request: ProductRequest) -> tuple[str, ...]:
        """Return the robots that may serve a request."""
        return self.state.robot_ids if request.robot == "any" else (request.robot,)

    def check_frames(self, request: ProductRequest, robots: Sequence[str], until_s: float) -> None:
        """Raise FrameNotFoundError for a frame in neither the profile nor the frame tree of the DPM.

        A frame of the profile may have no pose before its robot has started.
        """
        others = request.frames - {"site"}
        for frame in others - frames_of(self.state.profile) if others else ():
            try:
                known = self.finder.has_frame(frame, robots, until_s)
            except UnavailableError:
                return  # the query for the product reports it
            if not known:
                raise FrameNotFoundError(
                    f"frame {frame!r} is in neither the profile nor the DPM's frame tree"
                )

    def best(
        self,
        request: ProductRequest,
        robots: Sequence[str],
        match: ProductMatch | None,
        exclude: frozenset[ProviderId],
        until_s: float,
        horizon_s: float,
        holder: str = "",
    ) -> tuple[Plan | NoPlan, bool]:
        """Return the best plan, and True if it accounts for the coverage of the region.

        ``match`` is the product in the DPM, ``exclude`` the providers to avoid, ``until_s`` (monotonic) the
        limit of queries, ``horizon_s`` the time in which a robot must observe the missing part, ``holder``
        the job whose leases the plan replaces. A plan may include DFPCs without a process: the supervisor
        restarts them.
        """
        plans = self._plans(request, robots, match, exclude, until_s, horizon_s, holder)
        now, later = plans.now, plans.later
        waits = isinstance(now, NoPlan) or isinstance(later, NoPlan) or now.provider == later.provider
        selected, world = (later, plans.optimistic_world) if waits else (now, plans.world)
        if isinstance(selected, Plan):
            selected = self.adjusted(request, selected, world, until_s)
        return selected, plans.coverage is not None

    def adjusted(self, request: ProductRequest, selected: Plan, world: World, until_s: float) -> Plan:
        """Return a plan with the parameters that the request adjusts: cell size, range and period."""
        settings = {}
        for provider in selected.order:
            adjustables = world.choice(provider, selected.implementation(provider)).adjustables
            if not adjustables:
                continue
            distance_m = None
            if any(a.follows == "range_m" for a in adjustables):
                distance_m = self.finder.distance_m(request, provider.robot, until_s)
            requested = {
                "resolution_m": request.resolution_m,
                "period_s": request.every_s or None,
                "range_m": distance_m,
            }
            settings[provider] = settings_for(
                adjustables, {name: value for name, value in requested.items() if value is not None}
            )
        settings = {provider: values for provider, values in settings.items() if values}
        return replace(selected, settings=settings) if settings else selected

    def accuracies(self, request: ProductRequest, robots: Sequence[str], until_s: float) -> Accuracies:
        """Return the accuracy of each implementation of the DFPCs that provide the requested type.

        It is that of its newest product, else the described one. A DEGRADED product counts only while the
        DFPC is active: its next activation may be under better conditions. The result is empty for a request
        without bounds on the accuracy, or if the DPM does not answer.
        """
        known: Accuracies = {}
        if not request.accuracy.is_set:
            return known
        try:
            for provider, _ in self.state.world(optimistic=True, robots=robots).outputs_of(
                request.product, robots
            ):
                measured = self.finder.accuracies(provider.id, request.product, until_s)
                for choice in provider.choices:
                    accuracy = measured.get(choice.implementation)
                    if accuracy is None or not (choice.active or accuracy.status == "OK"):
                        accuracy = choice.accuracy
                    if accuracy is not None:
                        known[provider.id, choice.implementation] = accuracy
        except (UnavailableError, DeadlineError) as error:
            logger.info("the accuracy of the DFPCs for request %s is unknown: %s", request.id, error)
        return known

    def advice(self, request: ProductRequest, robots: Sequence[str], until_s: float) -> str:
        """Return which DFPCs met the bounds on the accuracy in their newest product."""
        meets = [
            f"{provider} ({implementation}) met the bounds in its newest product ({accuracy.text})"
            for (provider, implementation), accuracy in sorted(
                self.accuracies(request, robots, until_s).items()
            )
            if not request.accuracy.unmet(accuracy)
        ]
        return "; ".join(meets) or "the newest product of no DFPC meets the bounds"

    def explain(self, request: ProductRequest) -> Reply:
        """Return stored product, plan, alternatives and obstacles of a request; nothing is run.

        Raises FrameNotFoundError for an unknown frame.
        """
        robots = self.robots(request)
        until_s = self.timing.now_s() + request.deadline_s
        self.check_frames(request, robots, until_s)
        body: dict[str, Any] = {
            "request": request.id,
            "asked": request.describe(),
            "stored": None,
            "why_not_stored": "",
        }
        served = False
        try:
            best, unmet = self.finder.find(request, robots, until_s)
        except UnavailableError as error:
            best, unmet = None, f"the DPM: {error}"
        if best is not None:
            stored, assessment = best
            served = assessment.satisfies
            summary = delivery_summary(stored.candidate, assessment, self.clock.now_ns(), stored.frame)
            body["stored"] = {"id": stored.candidate.id, **summary}
        body["why_not_stored"] = "" if served else unmet
        match = None if best is None else best[0]
        plans = self._plans(request, robots, match, frozenset(), until_s, request.deadline_s)
        world, coverage, later = plans.world, plans.coverage, plans.later
        now = plans.now
        if isinstance(now, Plan):
            now = self.adjusted(request, now, world, until_s)
        body |= explain(world, request.product, robots, now)
        if plans.accuracies:
            body["accuracy"] = [
                {
                    "provider": str(provider),
                    "implementation": implementation,
                    "newest": accuracy.text,
                    "unmet": list(request.accuracy.unmet(accuracy)),
                }
                for (provider, implementation), accuracy in sorted(plans.accuracies.items())
            ]
        if coverage is not None:
            body["held"] = 0.0 if match is None else match.candidate.coverage
        if body["plan"] is None and isinstance(later, Plan):
            later = self.adjusted(request, later, plans.optimistic_world, until_s)
            body["plan"] = {
                **plan_with_costs(later, plans.optimistic_world),
                "waits_for": [str(m) for m in later.order if not world.providers[m].available],
            }
        # Without a better product, one that meets all mandatory requirements is served with its differences.
        acceptable = best is not None and best[1].acceptable
        body["would"] = "serve" if served else "make" if body["plan"] else "serve" if acceptable else "refuse"
        return Reply.of(body, kind="explanation", final=True, request=request.id)

    def _plans(
        self,
        request: ProductRequest,
        robots: Sequence[str],
        match: ProductMatch | None,
        exclude: frozenset[ProviderId],
        until_s: float,
        horizon_s: float,
        holder: str = "",
    ) -> _Plans:
        optimistic_world = self.state.world(
            optimistic=True, priority=request.priority, holder=holder, robots=robots, acquire=request.acquire
        )
        coverage = self._coverage(request, optimistic_world, robots, match, until_s, horizon_s)
        accuracies = self.accuracies(request, robots, until_s)
        misses = frozenset(p for p, accuracy in accuracies.items() if request.accuracy.unmet(accuracy))
        unstated = frozenset(p for p in misses if request.accuracy.has_unknown(accuracies[p]))
        # After the queries of coverage and accuracy, which take time.
        world = self.state.world(
            priority=request.priority, holder=holder, robots=robots, acquire=request.acquire
        )
        return _Plans(
            world=world,
            now=_plan(request, world, robots, exclude, coverage, (misses, unstated)),
            optimistic_world=optimistic_world,
            later=_plan(request, optimistic_world, robots, exclude, coverage, (misses, unstated)),
            coverage=coverage,
            accuracies=accuracies,
        )

    def _coverage(
        self,
        request: ProductRequest,
        world: World,
        robots: Sequence[str],
        match: ProductMatch | None,
        until_s: float,
        horizon_s: float,
    ) -> RegionCoverage | None:
        """Return the stored and reachable part of the region; None without a region, or if unknown.

        A match does not count if a provider declares the requested finer resolution.
        """
        if request.region is None or not request.is_spatial:
            return None
        if match is not None and _could_be_finer(request, world, robots, match):
            match = None
        try:
            return self.finder.coverage(request, robots, match, until_s, horizon_s)
        except CdffError as error:
            logger.info("the coverage of request %s is unknown: %s", request.id, error)
            return None


def _plan(
    request: ProductRequest,
    world: World,
    robots: Sequence[str],
    exclude: frozenset[ProviderId],
    coverage: RegionCoverage | None,
    avoided: Sequence[frozenset[tuple[ProviderId, str]]],
) -> Plan | NoPlan:
    """Return the cheapest plan with the requested resolution and accuracy, else with one of them, else any.

    For a pose of the base, DFPCs whose pose is that of a sensor are used only if no other one has a plan: the
    mount of the sensor need not be known.

    ``avoided`` are the implementations whose newest product does not meet the bounds on the accuracy, and
    those of them that do not state a bounded standard deviation: a DFPC whose accuracy is too low at present
    is preferred to one that provides no orientation.
    """
    providers = [
        choice for m in world.providers.values() if request.product in m.products for choice in m.choices
    ]
    limit_m = _limit_m(request)
    every = frozenset((m.id, m.implementation) for m in providers)
    fine = frozenset(
        (m.id, m.implementation) for m in providers if m.finest_m is None or m.finest_m <= limit_m
    )
    of_sensor = frozenset((m.id, m.implementation) for m in providers if request.product in m.sensor_products)
    indirect = of_sensor if request.child in (None, *(f"{robot}/base" for robot in robots)) else frozenset()
    result: Plan | NoPlan = NoPlan(())
    choices = (
        r - a - i for i in (indirect, frozenset()) for r in (fine, every) for a in (*avoided, frozenset())
    )
    for roots in dict.fromkeys(choices):
        if not roots and every:
            continue
        if coverage is None:
            result = plan(world, request.product, robots, exclude, roots)
        else:
            result = plan_coverage(world, request.product, robots, coverage, exclude, roots)
        if isinstance(result, Plan):
            break
    if request.acquire is not None and isinstance(result, Plan) and not result.acquisitions:
        sensors = ", ".join(map(str, sorted(result.modes))) or "none"
        reason = f"no sensor of the plan ({sensors}) has a mode for a single acquisition"
        parameters = "" if not request.acquire.values else f" with {request.acquire}"
        return NoPlan((reason + parameters,))
    return result


def _limit_m(request: ProductRequest) -> float:
    """Return the coarsest resolution that meets the request, metres."""
    return float("inf") if request.resolution_m is None else request.resolution_m * RESOLUTION_TOLERANCE


def _could_be_finer(
    request: ProductRequest, world: World, robots: Sequence[str], match: ProductMatch
) -> bool:
    """Return True if a match is too coarse and a DFPC declares the requested resolution."""
    limit_m, held_m = _limit_m(request), match.candidate.resolution_m
    if held_m is None or held_m <= limit_m:
        return False
    providers = (
        m for m in world.providers.values() if request.product in m.products and m.id.robot in robots
    )
    return any(m.finest_m is not None and m.finest_m <= limit_m for m in providers)
