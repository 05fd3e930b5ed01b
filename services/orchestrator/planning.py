# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What can be made for a request now: the plan to follow, and the explanation of what would be done."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

from cdff_common.bus import Reply
from cdff_common.clock import Clock
from cdff_common.errors import CdffError, FrameNotFoundError, UnavailableError
from cdff_core.orchestration.catalogue import frames_of
from cdff_core.orchestration.cover import Cover, plan_cover
from cdff_core.orchestration.explain import costed, explain
from cdff_core.orchestration.judge import RESOLUTION_TOLERANCE, delivered
from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.request import ProductRequest
from cdff_core.orchestration.world import MakerId, World
from services.orchestrator.finder import Finder, Found
from services.orchestrator.state import State
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)


class Planning:
    """Plans over what the state says is there and the finder says is held."""

    def __init__(self, state: State, finder: Finder, clock: Clock, timing: Timing = REAL) -> None:
        self._state = state
        self._finder = finder
        self._clock = clock
        self._timing = timing

    def robots(self, request: ProductRequest) -> tuple[str, ...]:
        """Robots that may serve a request."""
        return self._state.profile.robot_ids if request.robot == "any" else (request.robot,)

    def check_frames(self, request: ProductRequest, robots: Sequence[str], until_s: float) -> None:
        """Raise FrameNotFoundError for a frame that neither the mission nor the DPM knows of.

        One that the profile names may have no pose yet: that comes once its robot has started.
        """
        for frame in request.frames - frames_of(self._state.profile):
            try:
                known = self._finder.knows_frame(frame, robots, until_s)
            except UnavailableError:
                return  # the search for the product will say so
            if not known:
                raise FrameNotFoundError(f"frame {frame!r} is in neither the profile nor the DPM's frame tree")

    def best(
        self,
        request: ProductRequest,
        robots: Sequence[str],
        found: Found | None,
        exclude: frozenset[MakerId],
        until_s: float,
        horizon_s: float,
    ) -> tuple[Plan | NoPlan, bool]:
        """The plan to follow now, and whether the cover of the region was counted.

        ``found`` is what the DPM holds, ``exclude`` names who must not take part, ``until_s`` (monotonic) limits what
        is asked of the DPM, in ``horizon_s`` a robot must see what is missing. What is only away for a
        moment is planned with too: its supervisor brings it back, the control loop switches it on.
        """
        hopeful_world = self._state.world(hopeful=True, priority=request.priority)
        counted = None if found is not None and _could_be_finer(request, hopeful_world, robots, found) else found
        cover = self._cover(request, robots, counted, until_s, horizon_s)
        now = self._planned(request, self._state.world(priority=request.priority), robots, exclude, cover)
        hopeful = self._planned(request, hopeful_world, robots, exclude, cover)
        waits = isinstance(now, NoPlan) or isinstance(hopeful, NoPlan) or now.maker == hopeful.maker
        return (hopeful if waits else now), cover is not None

    def explain(self, request: ProductRequest) -> Reply:
        """Say what would be served or made for a request, what else could be, and why not; no job, nothing is run.

        Raises FrameNotFoundError for a frame that nobody knows.
        """
        robots = self.robots(request)
        until_s = self._timing.now_s() + request.deadline_s
        self.check_frames(request, robots, until_s)
        body: dict[str, Any] = {
            "request": request.id,
            "asked": request.describe(),
            "stored": None,
            "why_not_stored": "",
        }
        served = False
        try:
            found, why = self._finder.find(request, robots, until_s)
        except UnavailableError as error:
            found, why = None, f"the DPM: {error}"
        if found is not None:
            stored, judgement = found
            served = judgement.satisfies
            what = delivered(stored.candidate, judgement, request, self._clock.now_ns(), stored.frame)
            body["stored"] = {"id": stored.candidate.id, **what}
        body["why_not_stored"] = "" if served else why
        now = self._state.world(priority=request.priority)
        hopeful = self._state.world(hopeful=True, priority=request.priority)
        held_now = None if found is None else found[0]
        counted = None if held_now is not None and _could_be_finer(request, hopeful, robots, held_now) else held_now
        cover = self._cover(request, robots, counted, until_s, request.deadline_s)
        told = explain(now, request.product, robots, cover, self._planned(request, now, robots, frozenset(), cover))
        body |= told.describe(now)
        again = self._planned(request, hopeful, robots, frozenset(), cover)
        if cover is not None:
            body["held"] = 0.0 if held_now is None else held_now.candidate.coverage
        if body["plan"] is None and isinstance(again, Plan):
            body["plan"] = {
                **costed(again, hopeful),
                "waits_for": [str(m) for m in again.order if not now.makers[m].available],
            }
        # Where nothing better can be made, what meets all that is mandatory is served with its differences.
        acceptable = found is not None and found[1].acceptable
        body["would"] = "serve" if served else "make" if body["plan"] else "serve" if acceptable else "refuse"
        return Reply.of(body, kind="explanation", final=True, request=request.id)

    def _cover(
        self, request: ProductRequest, robots: Sequence[str], found: Found | None, until_s: float, horizon_s: float
    ) -> Cover | None:
        """What of the region is held and who can see the rest; None where no region is asked, or nobody can say."""
        if request.region is None or not request.is_spatial:
            return None
        try:
            return self._finder.cover(request, robots, found, until_s, horizon_s)
        except CdffError as error:
            logger.info("cover of request %s is not known: %s", request.id, error)
            return None

    @staticmethod
    def _planned(
        request: ProductRequest,
        world: World,
        robots: Sequence[str],
        exclude: frozenset[MakerId],
        cover: Cover | None,
    ) -> Plan | NoPlan:
        """The cheapest plan of those fine enough, else of all: coarser is delivered rather than nothing."""
        makers = [m for m in world.makers.values() if request.product in m.products]
        limit_m = _limit_m(request)
        fine = frozenset(m.id for m in makers if m.resolution_m is None or m.resolution_m <= limit_m)
        made: Plan | NoPlan = NoPlan(())
        for roots in (fine, None) if 0 < len(fine) < len(makers) else (None,):
            if cover is None:
                made = plan(world, request.product, robots, exclude, roots)
            else:
                made = plan_cover(world, request.product, robots, cover, exclude, roots)
            if isinstance(made, Plan):
                break
        return made


def _limit_m(request: ProductRequest) -> float:
    """Coarsest resolution that is as asked, metres."""
    return float("inf") if request.resolution_m is None else request.resolution_m * RESOLUTION_TOLERANCE


def _could_be_finer(request: ProductRequest, world: World, robots: Sequence[str], found: Found) -> bool:
    """Whether what is held is coarser than asked, and some DFPC declares that it makes it as fine."""
    limit_m, held_m = _limit_m(request), found.candidate.resolution_m
    if held_m is None or held_m <= limit_m:
        return False
    makers = (m for m in world.makers.values() if request.product in m.products and m.id.robot in robots)
    return any(m.resolution_m is not None and m.resolution_m <= limit_m for m in makers)
