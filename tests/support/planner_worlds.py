# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small worlds for the planner: sensors and DFPCs, given one by one or random from a seed."""

from __future__ import annotations

import random
from dataclasses import replace

from cdff_core.orchestration.planner import NoPlan, Plan
from cdff_core.orchestration.world import (
    Input,
    InputSource,
    Provider,
    ProviderId,
    SensorId,
    SensorState,
    World,
)

#: Modes of the random sensors in which they send samples.
STREAMING = ["m0", "m1", "m2"]


def sensor(name: str, **fields: object) -> SensorState:
    state: dict[str, object] = {"modes": {"off": False, "on": True}, "current": "off"}
    return SensorState(SensorId("mana", name), **{**state, **fields})  # type: ignore[arg-type]


def from_sensor(port: str, name: str, optional: bool = False) -> Input:
    return Input(port, (InputSource("sensor", "mana", name, "samples"),), optional)


def from_provider(port: str, *names: str, optional: bool = False) -> Input:
    return Input(port, tuple(InputSource("product", "mana", name, "out") for name in names), optional)


def provider(name: str, product: str | None, *inputs: Input, **fields: object) -> Provider:
    return Provider(ProviderId("mana", name), {"out": product}, inputs, **fields)  # type: ignore[arg-type]


def world(*parts: Provider | SensorState) -> World:
    return World(
        {p.id: p for p in parts if isinstance(p, Provider)},
        {p.id: p for p in parts if isinstance(p, SensorState)},
    )


def names(result: Plan | NoPlan) -> list[str]:
    """Return the DFPCs of a plan in the order of their activation."""
    assert isinstance(result, Plan), result
    return [provider.dfpc for provider in result.order]


def random_sensor(r: random.Random, name: str) -> SensorState:
    """Return a sensor whose modes may be held by jobs, refused or unreachable, and that may be lost."""
    held_mode = r.choice([None, None, None, "m0", "m1", "off"])
    firm_modes = retained_modes = None
    if held_mode is not None and r.random() < 0.6:
        firm_modes = frozenset({held_mode, *r.sample(STREAMING, r.randint(0, 3))})
        retained_modes = frozenset(m for m in firm_modes if m == held_mode or r.random() < 0.5)
    switch_s = (
        {m: r.choice([0.5, 2.0]) for m in ("off", *STREAMING) if r.random() < 0.8} if r.random() < 0.3 else {}
    )
    return SensorState(
        SensorId("mana", name),
        {"off": False, "m0": True, "m1": True, "m2": True},
        r.choice(["off", *STREAMING]),
        held_mode,
        firm_modes,
        retained_modes,
        dict.fromkeys(r.sample(STREAMING, r.choice([0, 0, 0, 1, 2])), "refused"),
        lost="gone" if r.random() < 0.05 else "",
        switch_s=switch_s,
        needs={m: {"power_w": float(r.randint(0, 4))} for m in ("off", *STREAMING)}
        if r.random() < 0.4
        else {},
    )


def random_world(seed: int) -> World:
    """Return one or two sensors and two to five providers with random wiring, state and resource limits."""
    r = random.Random(seed)
    sensors = [random_sensor(r, f"s{i}") for i in range(r.randint(1, 2))]
    count = r.randint(2, 5)
    providers = []
    for i in range(count):
        inputs = []
        for port in range(r.randint(0, 2)):
            sources = [InputSource("sensor", "mana", s.id.sensor, "x") for s in sensors]
            sources += [InputSource("product", "mana", f"d{j}", "out") for j in range(count) if j != i]
            inputs.append(
                Input(
                    f"p{port}", tuple(r.sample(sources, r.randint(0, min(2, len(sources))))), r.random() < 0.4
                )
            )
        modes = {}
        if r.random() < 0.4:
            modes[r.choice(sensors).id.sensor] = "|".join(r.sample(["off", *STREAMING], r.randint(1, 2)))
        active = r.random() < 0.2
        wired = {i.port: r.choice(i.sources) for i in inputs if active and i.sources and r.random() < 0.7}
        power_w = float(r.randint(0, 3))
        providers.append(
            Provider(
                ProviderId("mana", f"d{i}"),
                {"out": r.choice(["dem", "pose", None])},
                tuple(inputs),
                modes,
                cost=float(r.randint(1, 9)),
                cpu=r.randint(0, 8) / 8,
                memory_mb=float(r.randint(0, 5)),
                available=r.random() < 0.85,
                active=active,
                wired=wired,
                implementation="a",
                power_w=power_w,
            )
        )
        if r.random() < 0.3:
            other = {"cost": float(r.randint(1, 9)), "cpu": r.randint(0, 8) / 8, "power_w": power_w + 1.0}
            alternative = replace(providers[-1], implementation="b", active=False, wired={}, **other)
            providers[-1] = replace(providers[-1], alternatives=(alternative,))
    reserved = frozenset(p.id for p in providers if p.active or r.random() < 0.1)
    limits = {"memory_mb": float(r.randint(0, 12)), "cpu_cores": r.randint(0, 16) / 8}
    limits |= {"power_w": float(r.randint(0, 6))}
    free = {budget: limit for budget, limit in limits.items() if r.random() < 0.4}
    return World(
        {p.id: p for p in providers},
        {s.id: s for s in sensors},
        {"mana": free} if free else {},
        reserved,
    )
