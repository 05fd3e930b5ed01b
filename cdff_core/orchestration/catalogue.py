# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From descriptions of DFPCs and the mission profile to the planner's world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.profile import DfpcEntry, Profile
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconcile import Observed
from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, SensorState, Source, World

#: Frames of every robot (contract §6), and the origin of its visual odometry.
_ROBOT_FRAMES = ("base", "odom", "vo")


def frames_of(profile: Profile) -> frozenset[str]:
    """Frames that a mission has, whether or not a pose of them is known yet."""
    found = {"site"}
    for robot in profile.robots:
        found |= {f"{robot.id}/{name}" for name in (*_ROBOT_FRAMES, *robot.sensors)}
        found |= {sensor.frame for sensor in robot.sensors.values()}
        found |= {frame for edge in robot.frames for frame in (edge.parent, edge.child)}
    return frozenset(found)


def description_of(robot: str, entry: DfpcEntry, description: DfpcDescription) -> dict[str, Any]:
    """What ``dfpc/@rpc/describe`` would say of a DFPC whose process has not answered yet."""
    return {
        "name": entry.name,
        "robot": robot,
        "doc": description.doc,
        "version": description.version,
        "implementation": entry.implementation or description.implementations[0].name,
        "state": "unconfigured",
        "inputs": [
            {
                "port": p.attribute,
                "type": p.type_name,
                "optional": p.optional,
                "source": entry.inputs.get(p.attribute, ""),
            }
            for p in description.input_ports
        ],
        "outputs": [
            {"port": p.attribute, "type": p.type_name, "product": p.product or ""} for p in description.output_ports
        ],
        "modes": dict(entry.modes),
        "activation": entry.activation,
        "linger_s": entry.linger_s,
        "cost": {k: c.model_dump() for k, c in description.cost.items()},
    }


def maker_of(description: Mapping[str, Any], *, alive: bool, active: bool, why_not: str = "") -> Maker:
    """Return the maker that a description is of.

    Raises
    ------
    InputError
        If a field is missing or malformed: the description came over the network.
    """
    try:
        robot = str(description["robot"])
        cost = _cost(description)
        return Maker(
            MakerId(robot, str(description["name"])),
            outputs={str(o["port"]): (str(o["product"]) or None) for o in description["outputs"]},
            inputs=tuple(
                Input(str(i["port"]), _sources(robot, str(i["source"])), bool(i["optional"]))
                for i in description["inputs"]
            ),
            modes={str(s): str(m) for s, m in description["modes"].items()},
            implementation=str(description["implementation"]),
            cost=cost[0],
            memory_mb=cost[1],
            available=alive,
            active=active,
            why_not=why_not,
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"description of a DFPC: {type(error).__name__} {error}") from error


def world_of(
    profile: Profile,
    descriptions: Mapping[MakerId, Mapping[str, Any]],
    observed: Observed,
    leases: Leases,
    refused: Mapping[SensorId, frozenset[str]],
    *,
    hopeful: bool = False,
) -> World:
    """The world as it is now; ``hopeful`` takes every known DFPC as available, whether its process answers or not."""
    makers = {}
    for maker_id, description in descriptions.items():
        alive = hopeful or maker_id in observed.alive
        attempt = observed.attempts.get(maker_id)
        why = attempt.reason if attempt is not None and attempt.reason else "its process is not there"
        makers[maker_id] = maker_of(description, alive=alive, active=maker_id in observed.active, why_not=why)
    sensors = {}
    for robot in profile.robots:
        for name, sensor in robot.sensors.items():
            sensor_id = SensorId(robot.id, name)
            sensors[sensor_id] = SensorState(
                sensor_id,
                {m: mode.on for m, mode in sensor.modes.items()},
                observed.modes.get(sensor_id, sensor.initial_mode),
                leases.held_mode(sensor_id),
                refused.get(sensor_id, frozenset()),
            )
    reserved = frozenset(leases.wanted | observed.active) & makers.keys()
    return World(makers, sensors, _memory_left(profile, makers, reserved), reserved)


def _memory_left(profile: Profile, makers: Mapping[MakerId, Maker], reserved: frozenset[MakerId]) -> dict[str, float]:
    """What the robots with a limit ``memory_mb`` have left, megabytes, as the DFPCs declare what they need."""
    return {
        robot.id: robot.limits["memory_mb"] - sum(makers[m].memory_mb for m in reserved if m.robot == robot.id)
        for robot in profile.robots
        if "memory_mb" in robot.limits
    }


def feeds_of(world: World) -> dict[MakerId, frozenset[MakerId]]:
    """Which makers feed which, as wired."""
    return {
        m.id: frozenset(MakerId(s.robot, s.owner) for port in m.inputs for s in port.sources if s.kind == "product")
        for m in world.makers.values()
    }


def uses_of(world: World) -> dict[MakerId, frozenset[SensorId]]:
    """Which sensors each maker takes samples of or needs a mode of."""
    return {
        m.id: frozenset(
            {SensorId(s.robot, s.owner) for port in m.inputs for s in port.sources if s.kind == "sensor"}
            | {SensorId(m.id.robot, s) for s in m.modes}
        )
        for m in world.makers.values()
    }


def _sources(robot: str, wiring: str) -> tuple[Source, ...]:
    """Sources of a wiring ``sensor/{sensor}/{stream}`` or ``product/{dfpc}/{port}``; several are ``|``-separated."""
    sources = []
    for text in wiring.split("|") if wiring else ():
        kind, owner, item = text.split("/")
        if kind not in ("sensor", "product"):
            raise ValueError(f"source {text!r}: expected sensor/… or product/…")
        sources.append(Source(kind, robot, owner, item))
    return tuple(sources)


def _cost(description: Mapping[str, Any]) -> tuple[float, float]:
    """CPU seconds and megabytes of the dearest stated input; 1.0 and 0 where nothing was measured."""
    costs = [c for c in description.get("cost", {}).values() if isinstance(c, Mapping)]
    if not costs:
        return 1.0, 0.0
    return max(float(c["cpu_s"]) for c in costs), max(float(c["memory_mb"]) for c in costs)
