# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Planning of a request while the state of the system changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import FrameNotFoundError, UnavailableError
from cdff_common.interfaces.profile import load_profile
from cdff_core.orchestration.acceptance import Assessment, ProductCandidate
from cdff_core.orchestration.accuracy import Accuracy
from cdff_core.orchestration.coverage import RegionCoverage
from cdff_core.orchestration.planner import NoPlan, Plan
from cdff_core.orchestration.request import parse_request
from cdff_core.orchestration.world import Provider, ProviderId, World
from services.orchestrator.planning import RequestPlanner
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.state import SystemState

PROFILE = Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml"
MAPPING = ProviderId("mana", "digital_elevation_mapping")


class Finder:
    """Finder double without products; the process of ``MAPPING`` ends during the query of the coverage."""

    def __init__(self, state: SystemState) -> None:
        self.state = state

    def find(self, *_: object) -> tuple[None, str]:
        return None, "no product"

    def coverage(self, *_: object) -> None:
        self.state.set_alive(MAPPING, alive=False)


def test_a_plan_uses_the_state_after_the_query_of_the_coverage() -> None:
    state = SystemState(load_profile(PROFILE))
    for robot in state.profile.robots:
        for entry in robot.dfpcs:
            state.set_alive(ProviderId(robot.id, entry.name), alive=True)
    planner = RequestPlanner(state, Finder(state), ManualClock(0))  # type: ignore[arg-type]  # double
    request = parse_request({"type": "dem", "robot": "mana", "region": "circle:0,0,5"}, "mana")
    explanation = planner.explain(request).body()
    assert explanation["plan"]["waits_for"] == [str(MAPPING)]
    assert any(str(MAPPING) in reason for reason in explanation["why_not"])


S = 1_000_000_000
FINE, COARSE = ProviderId("mana", "fine"), ProviderId("mana", "coarse")


class TwoMappers:
    """State double: a costly provider of fine maps and a cheap one of coarse maps, of robot ``mana``."""

    profile = load_profile(PROFILE)
    robot_ids = ("mana", "minnie")

    def __init__(self, fine_m: float = 0.1) -> None:
        self.fine_m, self.running = fine_m, {FINE, COARSE}
        self.changes: dict[str, Any] = {}  # fields of the providers

    def world(self, *, optimistic: bool = False, **_: object) -> World:
        return World(
            {
                p: Provider(
                    p, {"dem": "dem", "pose": "pose"}, cost=cost, resolution_m=resolution_m,
                    available=optimistic or p in self.running, unavailable_reason="it ended", **self.changes,
                )
                for p, cost, resolution_m in ((FINE, 5.0, self.fine_m), (COARSE, 1.0, 0.5))
            }
        )  # fmt: skip


class StoredFinder:
    """Finder double with one stored product, or none."""

    def __init__(self, stored: ProductMatch | None = None, assessment: Assessment | None = None) -> None:
        self.stored, self.assessment = stored, assessment or Assessment()
        self.covered_by: list[ProductMatch | None] = []

    def find(self, *_: object) -> tuple[Any, str]:
        return (self.stored and (self.stored, self.assessment)), self.assessment.unmet or "none"

    def coverage(self, request: object, robots: object, match: ProductMatch | None, *_: object) -> Any:
        self.covered_by.append(match)
        return RegionCoverage(requested=0b1111, stored=0 if match is None else 0b0011, required_count=1)

    def has_frame(self, frame: str, *_: object) -> bool:
        if frame == "unknown_now":
            raise UnavailableError("away")
        return frame == "stored"


def dem(resolution_m: float | None = None, coverage: float | None = 0.5) -> ProductMatch:
    candidate = ProductCandidate("mana/dem", "mana", 90 * S, 90 * S, resolution_m, coverage)
    return ProductMatch(candidate, (), None, "site")


def two_mappers(finder: StoredFinder, state: TwoMappers | None = None) -> RequestPlanner:
    return RequestPlanner(state or TwoMappers(), finder, ManualClock(100 * S))  # type: ignore[arg-type]


def request(**parameters: str) -> Any:
    return parse_request({"type": "dem", "region": "circle:0,0,5", **parameters}, "mana")


def planned(finder: StoredFinder, match: ProductMatch | None = None, **parameters: Any) -> ProviderId:
    state = parameters.pop("state", None)
    exclude = parameters.pop("exclude", frozenset())
    plan, is_covered = two_mappers(finder, state).best(
        request(**parameters), ("mana",), match, exclude, 0.0, 10.0
    )
    assert isinstance(plan, Plan)
    assert is_covered
    return plan.provider


def test_the_cheapest_provider_of_the_requested_resolution_is_planned() -> None:
    assert planned(StoredFinder()) == COARSE
    for resolution, provider in (("0.1", FINE), ("0.4", FINE), ("0.5", COARSE)):
        assert planned(StoredFinder(), resolution_m=resolution) == provider
    assert planned(StoredFinder(), resolution_m="0.05") == COARSE  # none is fine enough: any
    assert planned(StoredFinder(), resolution_m="0.1", exclude=frozenset({FINE})) == COARSE


def test_resolutions_that_differ_by_a_thousandth_are_equal() -> None:
    assert planned(StoredFinder(), state=TwoMappers(0.1 * 1.0009), resolution_m="0.1") == FINE
    assert planned(StoredFinder(), state=TwoMappers(0.1 * 1.0011), resolution_m="0.1") == COARSE


@pytest.mark.parametrize(
    ("stored_m", "requested", "counts"),
    [
        (0.2, "0.1", False),  # too coarse, and a provider can make a finer one
        (0.1, "0.1", True),
        (0.2, "0.05", True),  # too coarse, but nothing finer can be made
        (None, "0.1", True),
        (0.2, None, True),
    ],
)
def test_a_stored_map_covers_the_region_unless_a_finer_one_can_be_made(
    stored_m: float | None, requested: str | None, counts: bool
) -> None:
    finder, match = StoredFinder(), dem(stored_m)
    planned(finder, match, **({"resolution_m": requested} if requested else {}))
    assert finder.covered_by == [match if counts else None]


def test_a_restartable_provider_is_planned_unless_another_one_runs() -> None:
    state = TwoMappers()
    state.running = set()
    assert planned(StoredFinder(), state=state) == COARSE
    state.running = {FINE}
    assert planned(StoredFinder(), state=state) == FINE


def explained(finder: StoredFinder, state: TwoMappers | None = None, **parameters: str) -> dict[str, Any]:
    body: dict[str, Any] = two_mappers(finder, state).explain(request(**parameters)).body()
    return body


def test_a_product_that_meets_the_request_is_served() -> None:
    body = explained(StoredFinder(dem()))
    assert (body["would"], body["why_not_stored"], body["held"]) == ("serve", "", 0.5)
    assert (body["stored"]["id"], body["stored"]["age_s"], body["stored"]["frame"]) == (
        "mana/dem",
        10.0,
        "site",
    )


def test_a_product_that_does_not_meet_the_request_is_made_again_or_served_with_its_differences() -> None:
    coarse, too_old = Assessment(shortfalls=("resolution",)), Assessment(violations=("age",))
    body = explained(StoredFinder(dem(), coarse))
    assert (body["would"], body["why_not_stored"]) == ("make", "resolution")
    idle = TwoMappers()
    idle.world = lambda **_: World({})  # type: ignore[method-assign]  # no provider at all
    assert explained(StoredFinder(dem(), coarse), idle)["would"] == "serve"
    assert explained(StoredFinder(dem(), too_old), idle)["would"] == "refuse"
    nothing = explained(StoredFinder(), idle)
    assert (nothing["would"], nothing["stored"], nothing["held"]) == ("refuse", None, 0.0)


def test_without_a_region_the_held_part_is_not_stated() -> None:
    body: dict[str, Any] = two_mappers(StoredFinder()).explain(parse_request({"type": "dem"}, "mana")).body()
    assert "held" not in body
    assert body["plan"]["provider"] == str(COARSE)
    assert "waits_for" not in body["plan"]


def test_an_unavailable_dpm_is_the_reason_why_nothing_is_stored() -> None:
    finder = StoredFinder()
    finder.find = lambda *_: (_ for _ in ()).throw(UnavailableError("away"))  # type: ignore[method-assign]
    body = explained(finder)
    assert (body["stored"], body["why_not_stored"], body["would"]) == (None, "the DPM: away", "make")


def test_a_request_for_any_robot_is_planned_with_all() -> None:
    planner = two_mappers(StoredFinder())
    any_robot = parse_request({"type": "dem", "robot": "any"}, "ground")
    assert planner.robots(any_robot) == ("mana", "minnie")
    assert planner.robots(parse_request({"type": "dem", "robot": "minnie"}, "ground")) == ("minnie",)


def test_frames_are_known_by_the_profile_or_the_dpm_and_not_judged_without_it() -> None:
    planner = two_mappers(StoredFinder())
    for frame in ("site", "mana/base", "stored", "unknown_now"):
        planner.check_frames(request(frame=frame), ("mana",), 0.0)
    with pytest.raises(FrameNotFoundError, match="nosuch"):
        planner.check_frames(request(frame="nosuch"), ("mana",), 0.0)


class MeasuringFinder(StoredFinder):
    """Finder double in which the DFPCs of the DPM's products have an accuracy."""

    measured: Accuracy

    def accuracies(self, *_: object) -> dict[str, Accuracy]:
        return {"": self.measured}


@pytest.mark.parametrize(
    ("status", "is_active", "counts"),
    [("OK", False, True), ("OK", True, True), ("DEGRADED", True, True), ("DEGRADED", False, False)],
)
def test_a_degraded_product_of_an_earlier_activation_is_not_the_accuracy_of_a_dfpc(
    status: str, is_active: bool, counts: bool
) -> None:
    finder = MeasuringFinder()
    finder.measured = Accuracy(sigma_m=6.0, status=status)
    described = Accuracy(sigma_m=0.02)
    state = TwoMappers()
    state.changes = {"active": is_active, "accuracy": described}
    planner = RequestPlanner(state, finder, ManualClock(0))  # type: ignore[arg-type]  # doubles
    request = parse_request({"type": "dem", "robot": "mana", "max_sigma_m": "0.1"}, "mana")
    known = planner.accuracies(request, ["mana"], 1.0)
    assert known == dict.fromkeys(((FINE, ""), (COARSE, "")), finder.measured if counts else described)


def test_a_dfpc_with_too_low_an_accuracy_is_preferred_to_one_that_does_not_state_it() -> None:
    """The cheaper provider states no orientation, as for bearings; the other one may become better."""
    accuracy = {FINE: Accuracy(0.4, 1.0, status="DEGRADED"), COARSE: Accuracy(38.0)}

    class Finder(StoredFinder):
        def accuracies(self, provider: ProviderId, *_: object) -> dict[str, Accuracy]:
            return {"": accuracy[provider]}

    state = TwoMappers()
    state.changes = {"active": True}
    bounds = {"max_sigma_m": "0.3", "max_sigma_deg": "10"}
    selected, _ = RequestPlanner(state, Finder(), ManualClock(0)).best(  # type: ignore[arg-type]  # doubles
        parse_request({"type": "pose", **bounds}, "mana"), ("mana",), None, frozenset(), 0.0, 10.0
    )
    assert isinstance(selected, Plan)
    assert selected.provider == FINE


@pytest.mark.parametrize(("acquire", "end"), [("now", "acquisition"), ("pan_deg:30", " with pan_deg:30.0")])
def test_a_plan_without_a_sensor_for_single_acquisitions_is_refused_with_the_parameters(
    acquire: str, end: str
) -> None:
    result, _ = two_mappers(StoredFinder()).best(
        request(acquire=acquire), ("mana",), None, frozenset(), 0.0, 10.0
    )
    assert isinstance(result, NoPlan)
    assert result.text.startswith("no sensor of the plan (none) has a mode for a single acquisition")
    assert result.text.endswith(end)


class SensorPoses(TwoMappers):
    """State double: the cheap provider has the pose of a sensor, the costly one that of the base."""

    def world(self, *, optimistic: bool = False, **options: object) -> World:
        world = super().world(optimistic=optimistic, **options)
        cheap = replace(world.providers[COARSE], sensor_products=frozenset({"pose"}))
        return World({**world.providers, COARSE: cheap})


@pytest.mark.parametrize(("child", "provider"), [(None, FINE), ("mana/base", FINE), ("mana/lidar", COARSE)])
def test_a_pose_of_the_base_is_planned_with_a_provider_of_it(child: str | None, provider: ProviderId) -> None:
    state = SensorPoses()
    parameters = {"type": "pose"} | ({} if child is None else {"child": child})
    plan, _ = two_mappers(StoredFinder(), state).best(
        parse_request(parameters, "mana"), ("mana",), None, frozenset(), 0.0, 10.0
    )
    assert isinstance(plan, Plan)
    assert plan.provider == provider


def test_without_a_provider_of_the_base_the_pose_of_a_sensor_is_planned() -> None:
    exclude = frozenset({FINE})
    plan, _ = two_mappers(StoredFinder(), SensorPoses()).best(
        parse_request({"type": "pose"}, "mana"), ("mana",), None, exclude, 0.0, 10.0
    )
    assert isinstance(plan, Plan)
    assert plan.provider == COARSE
