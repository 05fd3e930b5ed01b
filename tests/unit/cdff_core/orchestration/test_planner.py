# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plans for small examples, and for hundreds of generated worlds compared with an exhaustive search."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import pytest

from cdff_core.orchestration.budgets import added, excess
from cdff_core.orchestration.planner import (
    MODE_COST,
    OMITTED_INPUT_COST,
    REWIRE_COST,
    TAKE_COST,
    NoPlan,
    Plan,
    plan,
)
from cdff_core.orchestration.world import (
    Input,
    InputSource,
    Provider,
    ProviderId,
    SensorId,
    SensorState,
    World,
)
from tests.support.planner_worlds import (
    from_provider,
    from_sensor,
    names,
    provider,
    random_world,
    sensor,
    world,
)

LIDAR = SensorId("mana", "lidar")


def test_a_plan_for_a_dem_contains_the_providers_of_its_inputs_upstream_ones_first() -> None:
    w = world(
        provider(
            "dem",
            "dem",
            from_sensor("scan", "lidar"),
            from_provider("poses", "position"),
            modes={"lidar": "on"},
        ),
        provider("position", "pose", from_provider("visual_odometry", "vo")),
        provider("vo", None, from_sensor("stereo", "navcam")),
        sensor("lidar"),
        sensor("navcam"),
    )
    planned = plan(w, "dem", ["mana"])
    assert names(planned) == ["vo", "position", "dem"]
    assert isinstance(planned, Plan)
    assert planned.modes == {LIDAR: "on", SensorId("mana", "navcam"): "on"}
    assert planned.cost == pytest.approx(3.0 + 2 * MODE_COST)


def test_a_stored_product_can_be_an_input_and_an_optional_input_that_closes_a_loop_is_omitted() -> None:
    stored = Input("orbital", (InputSource("dpm", "mana", "orbiter", "dem"),))
    w = world(
        provider(
            "located",
            "pose",
            from_provider("dem", "dem"),
            stored,
            from_provider("poses", "position", optional=True),
        ),
        provider("dem", "dem", from_sensor("scan", "lidar"), from_provider("poses", "position")),
        provider(
            "position", "pose", from_sensor("x", "wheels"), from_provider("fix", "located", optional=True)
        ),
        sensor("lidar"),
        sensor("wheels"),
    )
    planned = plan(w, "pose", ["mana"], roots=frozenset({ProviderId("mana", "located")}))
    assert names(planned) == ["position", "dem", "located"]
    assert isinstance(planned, Plan)
    assert planned.chosen_sources[ProviderId("mana", "located")]["orbital"] == "dpm/orbiter/dem"
    assert planned.omitted_inputs == ("mana/position.fix",)


def test_the_cheaper_provider_is_selected_and_running_ones_cost_nothing() -> None:
    parts = [
        provider("a", "pose", from_sensor("x", "lidar"), cost=3.0),
        provider("b", "pose", from_sensor("x", "lidar"), cost=2.0),
    ]
    assert names(plan(world(*parts, sensor("lidar")), "pose", ["mana"])) == ["b"]
    parts[0] = provider("a", "pose", from_sensor("x", "lidar"), cost=3.0, active=True)
    assert names(plan(world(*parts, sensor("lidar")), "pose", ["mana"])) == ["a"]


def test_an_optional_input_is_connected_if_possible_and_omitted_otherwise() -> None:
    position = provider(
        "position",
        "pose",
        from_sensor("imu", "imu", True),
        from_provider("visual_odometry", "vo", optional=True),
    )
    with_vo = plan(world(position, provider("vo", None), sensor("imu")), "pose", ["mana"])
    assert names(with_vo) == ["vo", "position"]
    without = plan(world(position, provider("vo", None, available=False), sensor("imu")), "pose", ["mana"])
    assert names(without) == ["position"]
    assert isinstance(without, Plan)
    assert without.omitted_inputs == ("mana/position.visual_odometry",)


def test_a_provider_without_connectable_inputs_yields_no_plan() -> None:
    planned = plan(
        world(provider("position", "pose", from_provider("odometry", "gone", optional=True))),
        "pose",
        ["mana"],
    )
    assert isinstance(planned, NoPlan)
    assert "position" in planned.text


def test_providers_that_depend_on_each_other_yield_no_plan() -> None:
    w = world(provider("a", "pose", from_provider("x", "b")), provider("b", None, from_provider("y", "a")))
    planned = plan(w, "pose", ["mana"])
    assert isinstance(planned, NoPlan)
    assert "depend on each other" in planned.text


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        ({"held": "off"}, "kept in mode off by another request"),
        ({"refused": {"on": "refused mode on"}}, "refused mode on"),
        ({"modes": {"off": False}}, "no mode on"),
    ],
)
def test_an_unavailable_sensor_is_the_reported_reason(state: dict[str, object], reason: str) -> None:
    w = world(
        provider("dem", "dem", from_sensor("scan", "lidar"), modes={"lidar": "on"}), sensor("lidar", **state)
    )
    planned = plan(w, "dem", ["mana"])
    assert isinstance(planned, NoPlan)
    assert reason in planned.text


def test_two_providers_that_need_different_modes_of_one_sensor_are_incompatible() -> None:
    w = world(
        provider("dem", "dem", from_provider("poses", "slam"), modes={"lidar": "fast"}),
        provider("slam", "pose", from_sensor("scan", "lidar"), modes={"lidar": "slow"}),
        sensor("lidar", modes={"off": False, "slow": True, "fast": True}),
    )
    planned = plan(w, "dem", ["mana"])
    assert isinstance(planned, NoPlan)
    assert "at once" in planned.text
    assert planned.nearest == ("pose of mana",)


def test_a_missing_provider_is_reported_with_the_available_types() -> None:
    planned = plan(world(provider("position", "pose")), "dem", ["mana"])
    assert isinstance(planned, NoPlan)
    assert "provides dem" in planned.text
    assert "pose of mana" in planned.text


def test_a_provider_that_failed_for_the_request_is_avoided() -> None:
    w = world(provider("a", "pose"), provider("b", "pose", cost=5.0))
    assert names(plan(w, "pose", ["mana"], frozenset({ProviderId("mana", "a")}))) == ["b"]


@pytest.mark.req("CDFF-SUP-076")
def test_plans_beyond_the_memory_budget_are_avoided_or_refused_with_the_values() -> None:
    small, large = (
        provider("small", "pose", cost=5.0, memory_mb=100.0),
        provider("large", "pose", memory_mb=300.0),
    )
    free = {"mana": {"memory_mb": 200.0}}
    w = world(small, large)
    assert names(plan(w, "pose", ["mana"])) == ["large"]
    assert names(plan(replace(w, free=free), "pose", ["mana"])) == ["small"]
    with_active = replace(w, free=free, reserved=frozenset({large.id}))
    assert names(plan(with_active, "pose", ["mana"])) == ["large"], (
        "a running provider needs no additional memory"
    )
    refused = plan(replace(world(large), free=free), "pose", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "300 MB, mana has 200 MB left" in refused.text


@pytest.mark.req("CDFF-SUP-076")
def test_plans_beyond_the_cpu_budget_are_avoided_or_refused_with_the_values() -> None:
    slow, fast = provider("slow", "pose", cost=5.0, cpu=0.2), provider("fast", "pose", cpu=0.8)
    assert names(plan(replace(world(slow, fast), free={"mana": {"cpu_cores": 0.5}}), "pose", ["mana"])) == [
        "slow"
    ]
    refused = plan(replace(world(fast), free={"mana": {"cpu_cores": 0.5}}), "pose", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "0.8 cores, mana has 0.5 cores left" in refused.text


def test_a_mode_that_satisfies_both_providers_is_selected() -> None:
    dem = provider("dem", "dem", from_provider("poses", "slam"), modes={"lidar": "fast|dense"})
    slam = provider("slam", "pose", from_sensor("scan", "lidar"), modes={"lidar": "slow|dense"})
    planned = plan(
        world(dem, slam, sensor("lidar", modes={"off": False, "slow": True, "fast": True, "dense": True})),
        "dem",
        ["mana"],
    )
    assert isinstance(planned, Plan)
    assert planned.modes == {LIDAR: "dense"}


def test_a_sensor_leased_at_lower_priority_is_taken_only_without_alternative() -> None:
    dem = provider("dem", "dem", from_sensor("scan", "lidar"), modes={"lidar": "fast"})
    leased = sensor(
        "lidar",
        modes={"off": False, "slow": True, "fast": True},
        current="slow",
        held="slow",
        priority_modes=frozenset({"slow", "fast"}),
        shared_modes=frozenset({"slow"}),
    )
    alone = plan(world(dem, leased), "dem", ["mana"])
    assert isinstance(alone, Plan)
    assert alone.modes == {LIDAR: "fast"}
    costly = provider("stereo_dem", "dem", cost=20.0)
    assert names(plan(world(dem, costly, leased), "dem", ["mana"])) == ["stereo_dem"]
    without_priority = replace(leased, priority_modes=frozenset({"slow"}))
    refused = plan(world(dem, without_priority), "dem", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "kept in mode slow by another request" in refused.text


def budget_world(**takeable: int) -> World:
    """Return a world of 2 cores: ``running`` DFPCs of half a core each use all of them."""
    running = [
        provider(name, None, from_sensor("x", "lidar"), cpu=0.5, active=True) for name in ("a", "b", "c", "d")
    ]
    dem = provider("dem", "dem", from_sensor("scan", "lidar"), from_provider("poses", "a"), cpu=0.8)
    reserved = frozenset(p.id for p in running)
    return replace(
        world(dem, *running, sensor("lidar", current="on")),
        free={"mana": {"cpu_cores": 0.0}},
        reserved=reserved,
        takeable={ProviderId("mana", name): priority for name, priority in takeable.items()},
    )


def test_providers_of_the_lowest_priority_are_stopped_if_the_cpu_is_not_sufficient() -> None:
    taking = plan(budget_world(a=1, b=3, c=2, d=3), "dem", ["mana"])
    assert isinstance(taking, Plan)
    assert names(taking) == ["a", "dem"]
    assert [p.dfpc for p in taking.takes] == ["d", "c"], "not its own input; b is kept before d by name"
    assert taking.cost > 2 * TAKE_COST
    assert taking.describe()["takes"] == ["mana/d", "mana/c"]


def test_providers_are_not_stopped_if_that_is_not_sufficient_or_not_necessary() -> None:
    refused = plan(budget_world(c=2), "dem", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "0.8 cores, mana has 0 cores left" in refused.text
    roomy = replace(budget_world(b=1, c=1), free={"mana": {"cpu_cores": 0.9}})
    fits = plan(roomy, "dem", ["mana"])
    assert isinstance(fits, Plan)
    assert fits.takes == ()


@pytest.mark.req("CDFF-SUP-199")
def test_a_plan_within_the_power_and_heat_of_the_robot_selects_modes_and_states_the_excess() -> None:
    modes = {"off": False, "fast": True, "slow": True}
    needs = {"off": {"power_w": 1.0}, "fast": {"power_w": 9.0}, "slow": {"power_w": 4.0}}
    lidar = sensor("lidar", modes=modes, needs=needs)
    dem = provider("dem", "dem", from_sensor("scan", "lidar"), power_w=2.0)
    roomy, tight, dark = (
        replace(world(dem, lidar), free={"mana": {"power_w": power_w}}) for power_w in (10.0, 5.0, 2.5)
    )
    assert modes_of(plan(roomy, "dem", ["mana"])) == {LIDAR: "fast"}
    slow = plan(tight, "dem", ["mana"])
    assert modes_of(slow) == {LIDAR: "slow"}
    assert isinstance(slow, Plan)
    assert slow.accepts == {LIDAR: ("slow", "fast")}  # the other mode is acceptable to other holders
    refused = plan(dark, "dem", ["mana"])
    assert isinstance(refused, NoPlan)
    assert refused.text.startswith("modes mana/lidar fast do not fit: 10 W, mana has 2.5 W left")
    hot = plan(replace(world(dem, lidar), free={"mana": {"heat_w": 1.0}}), "dem", ["mana"])
    assert isinstance(hot, NoPlan)
    assert "mana/dem does not fit: 2 W of heat, mana has 1 W of heat left" in hot.text


def camera_world(free_w: float) -> World:
    """Return a world with six cameras of four modes, the last of which needs 1 W, the others 2 W and more."""
    names = [f"camera_{k}" for k in range(6)]
    needs = {f"m{k}": {"power_w": 4.0 - k} for k in range(4)}
    modes = {"off": False, **dict.fromkeys(needs, True)}
    cameras = [sensor(name, modes=modes, needs={"off": {"power_w": 0.0}, **needs}) for name in names]
    inputs = [replace(from_sensor("image", name), port=name) for name in names]
    matcher = provider("match", "pose", *inputs)
    return replace(world(matcher, *cameras), free={"mana": {"power_w": free_w}})


def test_modes_within_the_budgets_are_found_among_thousands_of_combinations() -> None:
    assert set(modes_of(plan(camera_world(6.0), "pose", ["mana"])).values()) == {"m3"}
    assert sorted(modes_of(plan(camera_world(23.0), "pose", ["mana"])).values()) == [*["m0"] * 5, "m1"]
    refused = plan(camera_world(5.0), "pose", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "more than 1024 combinations of modes, the others are not compared" in refused.text


def test_a_mode_that_is_leased_and_not_reached_yet_needs_its_budgets() -> None:
    needs = {"off": {"power_w": 0.0}, "fast": {"power_w": 9.0}}
    modes = {"off": False, "fast": True}
    lidar = sensor("lidar", modes=modes, needs=needs, current="off", held="fast")
    assert lidar.reserved_needs == {"power_w": 9.0}
    assert lidar.added_needs("fast") == {"power_w": 0.0}
    assert lidar.added_needs("off") == {"power_w": -9.0}


def modes_of(planned: Plan | NoPlan) -> dict[SensorId, str]:
    assert isinstance(planned, Plan), planned
    return dict(planned.modes)


def test_the_cheapest_admitted_implementation_is_selected() -> None:
    accurate = provider("match", "pose", implementation="Accurate", cost=3.0)
    both = replace(accurate, alternatives=(replace(accurate, implementation="Fast", cost=1.0),))
    cheap = plan(world(both), "pose", ["mana"])
    assert isinstance(cheap, Plan)
    assert cheap.implementations == {both.id: ("Fast", "Accurate")}
    assert cheap.describe()["implementations"] == {"mana/match": "Fast"}
    assert cheap.cost == 1.0
    exact = plan(world(both), "pose", ["mana"], roots=frozenset({(both.id, "Accurate")}))
    assert isinstance(exact, Plan)
    assert exact.implementations == {both.id: ("Accurate",)}
    assert not exact.has_same_root(cheap)
    running = replace(both, active=True)
    kept = plan(world(running), "pose", ["mana"])
    assert isinstance(kept, Plan)
    assert kept.implementation(both.id) == "Accurate", "it runs already"


@pytest.mark.req("CDFF-SUP-141")
def test_the_cheapest_pose_source_is_selected_and_stated() -> None:
    dem = provider(
        "dem", "dem", from_sensor("scan", "lidar"), from_provider("poses", "position", "lidar_slam")
    )
    parts = [dem, provider("position", None, cost=3.0), provider("lidar_slam", None), sensor("lidar")]
    planned = plan(world(*parts), "dem", ["mana"])
    assert names(planned) == ["lidar_slam", "dem"]
    assert isinstance(planned, Plan)
    assert planned.chosen_sources[dem.id] == {
        "scan": "sensor/lidar/samples",
        "poses": "product/lidar_slam/out",
    }
    without = plan(world(*parts), "dem", ["mana"], frozenset({ProviderId("mana", "lidar_slam")}))
    assert names(without) == ["position", "dem"]


def test_a_plan_is_ready_after_the_slowest_chain_of_modes_and_warm_up() -> None:
    planned = plan(
        world(
            provider("dem", "dem", from_sensor("scan", "lidar"), from_provider("poses", "slam"), ready_s=1.0),
            provider("slam", None, from_sensor("stereo", "navcam"), ready_s=3.0),
            sensor("lidar", switch_s={"off": 0.0, "on": 5.0}),
            sensor("navcam", switch_s={"off": 0.0, "on": 0.5}),
        ),
        "dem",
        ["mana"],
    )
    assert isinstance(planned, Plan)
    assert planned.ready_s == 6.0


def cheapest_by_enumeration(w: World, product: str) -> float | None:
    """Return the cost of the cheapest valid plan over all subsets, implementations, sources and modes."""
    best: float | None = None
    ids = sorted(w.providers)
    for size in range(1, len(ids) + 1):
        for subset in itertools.combinations(ids, size):
            for selected in itertools.product(*(w.providers[m].choices for m in subset)):
                needs = [added_needs(w, p) for p in selected]
                free = w.free.get("mana", {})
                if excess(added(needs), free) is None and all(p.available for p in selected):
                    with_selected = replace(w, providers={**w.providers, **{p.id: p for p in selected}})
                    for cost in costs_of(with_selected, set(subset), product, added(needs)):
                        best = cost if best is None else min(best, cost)
    return best


def added_needs(w: World, selected: Provider) -> dict[str, float]:
    """Return the needs of a provider in addition to those that are allocated already."""
    running = w.providers[selected.id]
    if selected.id not in w.reserved:
        return selected.needs
    if running.implementation == selected.implementation:
        return {}
    return {budget: max(value - running.needs[budget], 0.0) for budget, value in selected.needs.items()}


def costs_of(w: World, chosen: set[ProviderId], product: str, used: dict[str, float]) -> Iterator[float]:
    """Yield the costs of all valid plans with exactly the chosen providers, which use some of the budgets."""
    if not any(product in w.providers[m].products for m in chosen):
        return
    ports = [(m, i) for m in sorted(chosen) for i in w.providers[m].inputs]
    choices = [[*i.sources, *([None] if i.optional else [])] for _, i in ports]
    for chosen_sources in itertools.product(*choices):
        pairs = [(m, i, s) for (m, i), s in zip(ports, chosen_sources, strict=True)]
        upstream = {
            m: {ProviderId(s.robot, s.owner) for n, _, s in pairs if n == m and s and s.kind == "product"}
            for m in chosen
        }
        if (
            any(f - chosen for f in upstream.values())
            or not acyclic(upstream)
            or not connected(w, upstream, product)
        ):
            continue
        if any(
            any(i.sources for i in w.providers[m].inputs) and not any(s for n, _, s in pairs if n == m)
            for m in chosen
        ):
            continue
        base = sum(0.0 if w.providers[m].active else w.providers[m].cost for m in chosen)
        base += sum(OMITTED_INPUT_COST for _, i, s in pairs if s is None and i.sources)
        base += sum(REWIRE_COST for m, i, s in pairs if s and w.providers[m].wired.get(i.port, s) != s)
        streams = {SensorId(s.robot, s.owner) for _, _, s in pairs if s and s.kind == "sensor"}
        yield from (base + extra for extra in mode_costs(w, chosen, streams, used))


def mode_costs(
    w: World, chosen: set[ProviderId], streams: set[SensorId], used: dict[str, float]
) -> Iterator[float]:
    """Yield the costs of all valid combinations of sensor modes; sensors in ``streams`` must stream."""
    requirements = [
        (SensorId("mana", s), modes.split("|")) for m in chosen for s, modes in w.providers[m].modes.items()
    ]
    needed = sorted({s for s, _ in requirements} | streams)
    for modes in itertools.product(*(list(w.sensors[s].modes) for s in needed)):
        mode_of = dict(zip(needed, modes, strict=True))
        changes = [w.sensors[s].added_needs(m) for s, m in mode_of.items()]
        if excess(added([used, *changes]), w.free.get("mana", {})) is not None:
            continue
        if any(mode_of[s] not in serve for s, serve in requirements) or not all(
            may_have_mode(w.sensors[s], mode_of[s]) for s in needed
        ):
            continue
        if all(w.sensors[s].modes[mode_of[s]] for s in streams):
            changed = sum(MODE_COST for s in needed if w.sensors[s].current != mode_of[s])
            yield changed + sum(TAKE_COST for s in needed if is_taken(w.sensors[s], mode_of[s]))


def may_have_mode(s: SensorState, mode: str) -> bool:
    allowed = s.priority_modes if s.priority_modes is not None else {s.held}
    return (
        not s.lost
        and (s.held is None or mode in allowed)
        and (mode not in s.refused or mode == s.current)
        and (not s.switch_s or mode in s.switch_s)
    )


def is_taken(s: SensorState, mode: str) -> bool:
    return s.held is not None and s.shared_modes is not None and mode not in s.shared_modes


def acyclic(upstream: dict[ProviderId, set[ProviderId]]) -> bool:
    remaining = {m: set(f) for m, f in upstream.items()}
    while remaining:
        ready = {m for m, f in remaining.items() if not f & set(remaining)}
        if not ready:
            return False
        for m in ready:
            del remaining[m]
    return True


def connected(w: World, upstream: dict[ProviderId, set[ProviderId]], product: str) -> bool:
    """Return whether all providers are upstream of a provider of the product, so that none is unused."""
    for root in (m for m in upstream if product in w.providers[m].products):
        reached, stack = set(), [root]
        while stack:
            m = stack.pop()
            if m not in reached:
                reached.add(m)
                stack.extend(upstream[m])
        if reached == set(upstream):
            return True
    return False


@pytest.mark.req("CDFF-SUP-140")
@pytest.mark.parametrize("block", range(10))
def test_generated_worlds_are_planned_at_the_optimal_cost(block: int) -> None:
    for seed in range(40 * block, 40 * block + 40):
        w = random_world(seed)
        result, expected_cost = plan(w, "dem", ["mana"]), cheapest_by_enumeration(w, "dem")
        if expected_cost is None:
            assert isinstance(result, NoPlan), seed
            assert result.reasons, seed
        else:
            assert isinstance(result, Plan), (seed, result)
            assert result.cost == pytest.approx(expected_cost), seed


def test_a_hundred_dfpcs_are_planned_within_the_limit_on_steps() -> None:
    chain = [provider("d0", None, from_sensor("x", "lidar"))]
    chain += [
        provider(f"d{i}", "dem" if i == 99 else None, from_provider("x", f"d{i - 1}", optional=i % 3 == 0))
        for i in range(1, 100)
    ]
    assert len(names(plan(world(*chain, sensor("lidar")), "dem", ["mana"]))) == 100
