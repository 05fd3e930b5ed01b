# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plans: examples a person can check, and some hundred generated worlds against exhaustive search."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator
from dataclasses import replace

import pytest

from cdff_core.orchestration.planner import MODE_COST, REWIRE_COST, TAKE_COST, UNFED_COST, NoPlan, Plan, plan
from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, SensorState, Source, World

LIDAR = SensorId("mana", "lidar")


def sensor(name: str, **more: object) -> SensorState:
    state: dict[str, object] = {"modes": {"off": False, "on": True}, "current": "off"}
    return SensorState(SensorId("mana", name), **{**state, **more})  # type: ignore[arg-type]


def from_sensor(port: str, name: str, optional: bool = False) -> Input:
    return Input(port, (Source("sensor", "mana", name, "samples"),), optional)


def from_maker(port: str, *names: str, optional: bool = False) -> Input:
    return Input(port, tuple(Source("product", "mana", name, "out") for name in names), optional)


def maker(name: str, product: str | None, *inputs: Input, **more: object) -> Maker:
    return Maker(MakerId("mana", name), {"out": product}, inputs, **more)  # type: ignore[arg-type]


def world(*parts: Maker | SensorState) -> World:
    return World(
        {p.id: p for p in parts if isinstance(p, Maker)}, {p.id: p for p in parts if isinstance(p, SensorState)}
    )


def names(made: Plan | NoPlan) -> list[str]:
    assert isinstance(made, Plan), made
    return [m.dfpc for m in made.order]


def test_a_dem_needs_clouds_and_poses_and_feeders_come_first() -> None:
    w = world(
        maker("dem", "dem", from_sensor("scan", "lidar"), from_maker("poses", "position"), modes={"lidar": "on"}),
        maker("position", "pose", from_maker("visual_odometry", "vo")),
        maker("vo", None, from_sensor("stereo", "navcam")),
        sensor("lidar"), sensor("navcam"),
    )  # fmt: skip
    made = plan(w, "dem", ["mana"])
    assert names(made) == ["vo", "position", "dem"]
    assert isinstance(made, Plan)
    assert made.modes == {LIDAR: "on", SensorId("mana", "navcam"): "on"}
    assert made.cost == pytest.approx(3.0 + 2 * MODE_COST)


def test_what_the_dpm_holds_feeds_an_input_at_no_cost_and_a_fix_that_goes_back_is_no_feeder_to_wait_for() -> None:
    stored = Input("orbital", (Source("dpm", "mana", "orbiter", "dem"),))
    w = world(
        maker("located", "pose", from_maker("dem", "dem"), stored, from_maker("poses", "position", optional=True)),
        maker("dem", "dem", from_sensor("scan", "lidar"), from_maker("poses", "position")),
        maker("position", "pose", from_sensor("x", "wheels"), from_maker("fix", "located", optional=True)),
        sensor("lidar"), sensor("wheels"),
    )  # fmt: skip
    made = plan(w, "pose", ["mana"], roots=frozenset({MakerId("mana", "located")}))
    assert names(made) == ["position", "dem", "located"]
    assert isinstance(made, Plan)
    assert made.feeding[MakerId("mana", "located")]["orbital"] == "dpm/orbiter/dem"
    assert made.unfed == ("mana/position.fix",)


def test_the_cheaper_of_two_makers_is_taken_and_what_runs_already_costs_nothing() -> None:
    parts = [
        maker("a", "pose", from_sensor("x", "lidar"), cost=3.0),
        maker("b", "pose", from_sensor("x", "lidar"), cost=2.0),
    ]
    assert names(plan(world(*parts, sensor("lidar")), "pose", ["mana"])) == ["b"]
    parts[0] = maker("a", "pose", from_sensor("x", "lidar"), cost=3.0, active=True)
    assert names(plan(world(*parts, sensor("lidar")), "pose", ["mana"])) == ["a"]


def test_a_wired_optional_input_is_fed_where_it_can_be_and_left_out_where_it_cannot() -> None:
    position = maker(
        "position", "pose", from_sensor("imu", "imu", True), from_maker("visual_odometry", "vo", optional=True)
    )
    with_vo = plan(world(position, maker("vo", None), sensor("imu")), "pose", ["mana"])
    assert names(with_vo) == ["vo", "position"]
    without = plan(world(position, maker("vo", None, available=False), sensor("imu")), "pose", ["mana"])
    assert names(without) == ["position"]
    assert isinstance(without, Plan)
    assert without.unfed == ("mana/position.visual_odometry",)


def test_a_maker_none_of_whose_inputs_can_be_fed_is_no_plan() -> None:
    made = plan(world(maker("position", "pose", from_maker("odometry", "gone", optional=True))), "pose", ["mana"])
    assert isinstance(made, NoPlan)
    assert "position" in made.text


def test_makers_that_wait_for_each_other_are_no_plan() -> None:
    w = world(maker("a", "pose", from_maker("x", "b")), maker("b", None, from_maker("y", "a")))
    made = plan(w, "pose", ["mana"])
    assert isinstance(made, NoPlan)
    assert "wait for each other" in made.text


@pytest.mark.parametrize(
    ("state", "why"),
    [
        ({"held": "off"}, "kept in mode off by another request"),
        ({"refused": frozenset({"on"})}, "refused mode on"),
        ({"modes": {"off": False}}, "no mode on"),
    ],
)
def test_a_sensor_that_cannot_be_had_is_the_reason_given(state: dict[str, object], why: str) -> None:
    w = world(maker("dem", "dem", from_sensor("scan", "lidar"), modes={"lidar": "on"}), sensor("lidar", **state))
    made = plan(w, "dem", ["mana"])
    assert isinstance(made, NoPlan)
    assert why in made.text


def test_two_makers_that_need_one_sensor_in_two_modes_do_not_go_together() -> None:
    w = world(
        maker("dem", "dem", from_maker("poses", "slam"), modes={"lidar": "fast"}),
        maker("slam", "pose", from_sensor("scan", "lidar"), modes={"lidar": "slow"}),
        sensor("lidar", modes={"off": False, "slow": True, "fast": True}),
    )
    made = plan(w, "dem", ["mana"])
    assert isinstance(made, NoPlan)
    assert "at once" in made.text
    assert made.nearest == ("pose of mana",)


def test_nothing_that_makes_the_product_says_so_and_names_what_can_be_made() -> None:
    made = plan(world(maker("position", "pose")), "dem", ["mana"])
    assert isinstance(made, NoPlan)
    assert "makes dem" in made.text
    assert "pose of mana" in made.text


def test_a_maker_that_failed_for_the_request_is_planned_around() -> None:
    w = world(maker("a", "pose"), maker("b", "pose", cost=5.0))
    assert names(plan(w, "pose", ["mana"], frozenset({MakerId("mana", "a")}))) == ["b"]


@pytest.mark.req("CDFF-SUP-076")
def test_what_does_not_fit_into_the_memory_that_is_left_is_planned_around_or_refused_with_the_figures() -> None:
    small, large = maker("small", "pose", cost=5.0, memory_mb=100.0), maker("large", "pose", memory_mb=300.0)
    free = {"mana": 200.0}
    w = world(small, large)
    assert names(plan(w, "pose", ["mana"])) == ["large"]
    assert names(plan(replace(w, memory_free_mb=free), "pose", ["mana"])) == ["small"]
    held = replace(w, memory_free_mb=free, reserved=frozenset({large.id}))
    assert names(plan(held, "pose", ["mana"])) == ["large"], "what runs already needs no more"
    refused = plan(replace(world(large), memory_free_mb=free), "pose", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "300 MB, mana has 200 MB left" in refused.text


@pytest.mark.req("CDFF-SUP-076")
def test_what_takes_more_cpu_than_the_robot_has_left_is_planned_around_or_refused_with_the_figures() -> None:
    slow, fast = maker("slow", "pose", cost=5.0, cpu=0.2), maker("fast", "pose", cpu=0.8)
    assert names(plan(replace(world(slow, fast), cpu_free={"mana": 0.5}), "pose", ["mana"])) == ["slow"]
    refused = plan(replace(world(fast), cpu_free={"mana": 0.5}), "pose", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "0.8 cores, mana has 0.5 cores left" in refused.text


def test_one_mode_that_serves_both_is_found() -> None:
    dem = maker("dem", "dem", from_maker("poses", "slam"), modes={"lidar": "fast|dense"})
    slam = maker("slam", "pose", from_sensor("scan", "lidar"), modes={"lidar": "slow|dense"})
    made = plan(
        world(dem, slam, sensor("lidar", modes={"off": False, "slow": True, "fast": True, "dense": True})),
        "dem", ["mana"],
    )  # fmt: skip
    assert isinstance(made, Plan)
    assert made.modes == {LIDAR: "dense"}


def test_a_sensor_of_a_lower_priority_is_taken_only_where_nothing_else_makes_the_product() -> None:
    dem = maker("dem", "dem", from_sensor("scan", "lidar"), modes={"lidar": "fast"})
    held = sensor(
        "lidar", modes={"off": False, "slow": True, "fast": True}, current="slow", held="slow",
        firm=frozenset({"slow", "fast"}), kept=frozenset({"slow"}),
    )  # fmt: skip
    alone = plan(world(dem, held), "dem", ["mana"])
    assert isinstance(alone, Plan)
    assert alone.modes == {LIDAR: "fast"}
    dear = maker("stereo_dem", "dem", cost=20.0)
    assert names(plan(world(dem, dear, held), "dem", ["mana"])) == ["stereo_dem"]
    firm = replace(held, firm=frozenset({"slow"}))
    refused = plan(world(dem, firm), "dem", ["mana"])
    assert isinstance(refused, NoPlan)
    assert "kept in mode slow by another request" in refused.text


@pytest.mark.req("CDFF-SUP-141")
def test_poses_come_from_the_cheapest_of_those_wired_and_the_plan_says_which() -> None:
    dem = maker("dem", "dem", from_sensor("scan", "lidar"), from_maker("poses", "position", "lidar_slam"))
    parts = [dem, maker("position", None, cost=3.0), maker("lidar_slam", None), sensor("lidar")]
    made = plan(world(*parts), "dem", ["mana"])
    assert names(made) == ["lidar_slam", "dem"]
    assert isinstance(made, Plan)
    assert made.feeding[dem.id] == {"scan": "sensor/lidar/samples", "poses": "product/lidar_slam/out"}
    without = plan(world(*parts), "dem", ["mana"], frozenset({MakerId("mana", "lidar_slam")}))
    assert names(without) == ["position", "dem"]


def test_a_plan_is_ready_after_the_slowest_chain_of_modes_and_warm_up() -> None:
    made = plan(
        world(
            maker("dem", "dem", from_sensor("scan", "lidar"), from_maker("poses", "slam"), ready_s=1.0),
            maker("slam", None, from_sensor("stereo", "navcam"), ready_s=3.0),
            sensor("lidar", switch_s={"off": 0.0, "on": 5.0}), sensor("navcam", switch_s={"off": 0.0, "on": 0.5}),
        ),
        "dem", ["mana"],
    )  # fmt: skip
    assert isinstance(made, Plan)
    assert made.ready_s == 6.0


# -- against exhaustive search ----------------------------------------------------------------------------------------


STREAMING = ["m0", "m1", "m2"]


def random_sensor(r: random.Random, name: str) -> SensorState:
    """A sensor that may be held, firmly or by lower priorities, refused, lost, or not reach a mode."""
    held = r.choice([None, None, None, "m0", "m1", "off"])
    firm = kept = None
    if held is not None and r.random() < 0.6:
        firm = frozenset({held, *r.sample(STREAMING, r.randint(0, 3))})
        kept = frozenset(m for m in firm if m == held or r.random() < 0.5)
    reach = {m: r.choice([0.5, 2.0]) for m in ("off", *STREAMING) if r.random() < 0.8} if r.random() < 0.3 else {}
    return SensorState(
        SensorId("mana", name), {"off": False, "m0": True, "m1": True, "m2": True}, r.choice(["off", *STREAMING]),
        held, firm, kept, frozenset(r.sample(STREAMING, r.choice([0, 0, 0, 1, 2]))),
        lost="gone" if r.random() < 0.05 else "", switch_s=reach,
    )  # fmt: skip


def random_world(seed: int) -> World:
    r = random.Random(seed)
    sensors = [random_sensor(r, f"s{i}") for i in range(r.randint(1, 2))]
    count = r.randint(2, 5)
    makers = []
    for i in range(count):
        inputs = []
        for port in range(r.randint(0, 2)):
            pool = [Source("sensor", "mana", s.id.sensor, "x") for s in sensors]
            pool += [Source("product", "mana", f"d{j}", "out") for j in range(count) if j != i]
            inputs.append(Input(f"p{port}", tuple(r.sample(pool, r.randint(0, min(2, len(pool))))), r.random() < 0.4))
        modes = {}
        if r.random() < 0.4:
            modes[r.choice(sensors).id.sensor] = "|".join(r.sample(["off", *STREAMING], r.randint(1, 2)))
        active = r.random() < 0.2
        wired = {i.port: r.choice(i.sources) for i in inputs if active and i.sources and r.random() < 0.7}
        makers.append(
            Maker(
                MakerId("mana", f"d{i}"), {"out": r.choice(["dem", "pose", None])}, tuple(inputs), modes,
                cost=float(r.randint(1, 9)), cpu=r.randint(0, 8) / 8, memory_mb=float(r.randint(0, 5)),
                available=r.random() < 0.85, active=active, wired=wired,
            )
        )  # fmt: skip
    reserved = frozenset(m.id for m in makers if m.active or r.random() < 0.1)
    free_mb = {"mana": float(r.randint(0, 12))} if r.random() < 0.4 else {}
    free_cpu = {"mana": r.randint(0, 16) / 8} if r.random() < 0.4 else {}
    return World({m.id: m for m in makers}, {s.id: s for s in sensors}, free_mb, free_cpu, reserved)


def cheapest_by_enumeration(w: World, product: str) -> float | None:
    """Cost of the cheapest sound plan over every subset of makers, feeding of inputs and choice of modes."""
    best: float | None = None
    ids = sorted(w.makers)
    for size in range(1, len(ids) + 1):
        for chosen in itertools.combinations(ids, size):
            new = [w.makers[m] for m in chosen if m not in w.reserved]
            fits = sum(m.memory_mb for m in new) <= w.memory_free_mb.get("mana", float("inf"))
            fits = fits and sum(m.cpu for m in new) <= w.cpu_free.get("mana", float("inf"))
            if fits and all(w.makers[m].available for m in chosen):
                for cost in costs_of(w, set(chosen), product):
                    best = cost if best is None else min(best, cost)
    return best


def costs_of(w: World, chosen: set[MakerId], product: str) -> Iterator[float]:
    if not any(product in w.makers[m].products for m in chosen):
        return
    ports = [(m, i) for m in sorted(chosen) for i in w.makers[m].inputs]
    choices = [[*i.sources, *([None] if i.optional else [])] for _, i in ports]
    for feeding in itertools.product(*choices):
        pairs = [(m, i, s) for (m, i), s in zip(ports, feeding, strict=True)]
        feeders = {
            m: {MakerId(s.robot, s.owner) for n, _, s in pairs if n == m and s and s.kind == "product"} for m in chosen
        }
        if any(f - chosen for f in feeders.values()) or not acyclic(feeders) or not connected(w, feeders, product):
            continue
        if any(
            any(i.sources for i in w.makers[m].inputs) and not any(s for n, _, s in pairs if n == m) for m in chosen
        ):
            continue
        base = sum(0.0 if w.makers[m].active else w.makers[m].cost for m in chosen)
        base += sum(UNFED_COST for _, i, s in pairs if s is None and i.sources)
        base += sum(REWIRE_COST for m, i, s in pairs if s and w.makers[m].wired.get(i.port, s) != s)
        streams = {SensorId(s.robot, s.owner) for _, _, s in pairs if s and s.kind == "sensor"}
        yield from (base + extra for extra in mode_costs(w, chosen, streams))


def mode_costs(w: World, chosen: set[MakerId], streams: set[SensorId]) -> Iterator[float]:
    named = [(SensorId("mana", s), modes.split("|")) for m in chosen for s, modes in w.makers[m].modes.items()]
    needed = sorted({s for s, _ in named} | streams)
    for modes in itertools.product(*(list(w.sensors[s].modes) for s in needed)):
        given = dict(zip(needed, modes, strict=True))
        if any(given[s] not in serve for s, serve in named) or not all(may_be(w.sensors[s], given[s]) for s in needed):
            continue
        if all(w.sensors[s].modes[given[s]] for s in streams):
            changed = sum(MODE_COST for s in needed if w.sensors[s].current != given[s])
            yield changed + sum(TAKE_COST for s in needed if is_taken(w.sensors[s], given[s]))


def may_be(s: SensorState, mode: str) -> bool:
    firm = s.firm if s.firm is not None else {s.held}
    return (
        not s.lost
        and (s.held is None or mode in firm)
        and (mode not in s.refused or mode == s.current)
        and (not s.switch_s or mode in s.switch_s)
    )


def is_taken(s: SensorState, mode: str) -> bool:
    return s.held is not None and s.kept is not None and mode not in s.kept


def acyclic(feeders: dict[MakerId, set[MakerId]]) -> bool:
    waiting = {m: set(f) for m, f in feeders.items()}
    while waiting:
        ready = {m for m, f in waiting.items() if not f & set(waiting)}
        if not ready:
            return False
        for m in ready:
            del waiting[m]
    return True


def connected(w: World, feeders: dict[MakerId, set[MakerId]], product: str) -> bool:
    """Whether one maker with the product draws in all the others: a plan has no bystanders."""
    for root in (m for m in feeders if product in w.makers[m].products):
        reached, stack = set(), [root]
        while stack:
            m = stack.pop()
            if m not in reached:
                reached.add(m)
                stack.extend(feeders[m])
        if reached == set(feeders):
            return True
    return False


@pytest.mark.req("CDFF-SUP-140")
@pytest.mark.parametrize("block", range(10))
def test_generated_worlds_are_planned_as_cheaply_as_exhaustive_search_finds(block: int) -> None:
    for seed in range(40 * block, 40 * block + 40):
        w = random_world(seed)
        found, wanted = plan(w, "dem", ["mana"]), cheapest_by_enumeration(w, "dem")
        if wanted is None:
            assert isinstance(found, NoPlan), seed
            assert found.reasons, seed
        else:
            assert isinstance(found, Plan), (seed, found)
            assert found.cost == pytest.approx(wanted), seed


def test_a_hundred_dfpcs_are_planned_within_the_bound_on_steps() -> None:
    chain = [maker("d0", None, from_sensor("x", "lidar"))]
    chain += [
        maker(f"d{i}", "dem" if i == 99 else None, from_maker("x", f"d{i - 1}", optional=i % 3 == 0))
        for i in range(1, 100)
    ]
    assert len(names(plan(world(*chain, sensor("lidar")), "dem", ["mana"]))) == 100
