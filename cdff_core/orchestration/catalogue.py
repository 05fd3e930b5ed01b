# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From descriptions of DFPCs, what is measured of them and the mission profile to the planner's world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.profile import DfpcEntry, Profile, Robot
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconcile import Observed
from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, SensorState, Source, World

#: Frames of every robot (contract §6), and the origin of its visual odometry.
_ROBOT_FRAMES = ("base", "odom", "vo")
#: Rate of a stream whose rate nobody states, Hz.
_UNKNOWN_RATE_HZ = 1.0
#: Cost of a maker that nobody measured.
_UNKNOWN_COST = 1.0
#: Samples after which what is measured goes before what is declared.
_ENOUGH_SAMPLES = 20


@dataclass(frozen=True, slots=True)
class Measured:
    """What a DFPC's status says it takes.

    Attributes
    ----------
    samples : int
        Since it was configured.
    cpu_s : float
        Of one sample, in the mean.
    load : float
        CPU seconds per second since its last status; 0 while it is not active.
    latency_s : float
        Of the last step.
    memory_mb : float
        Of its process.
    """

    samples: int = 0
    cpu_s: float = 0.0
    load: float = 0.0
    latency_s: float = 0.0
    memory_mb: float = 0.0

    def describe(self) -> dict[str, float]:
        """Plain data for the catalogue."""
        return {k: round(float(v), 6) for k, v in asdict(self).items()}

    @classmethod
    def of(cls, status: Mapping[str, Any], before: Measured | None, since_s: float) -> Measured:
        """Take a status; ``before`` is what the last one said, ``since_s`` ago.

        Raises
        ------
        InputError
            If a field is malformed: it came over the network.
        """
        try:
            samples, cpu_s = int(status.get("samples", 0)), float(status.get("mean_step_cpu_s", 0.0))
            latency_s, memory_mb = float(status.get("last_step_s", 0.0)), float(status.get("rss_mb", 0.0))
            load = 0.0
            if before is not None and since_s > 0.0 and samples > before.samples:
                load = (samples * cpu_s - before.samples * before.cpu_s) / since_s
            return cls(samples, cpu_s, max(load, 0.0), latency_s, memory_mb)
        except (TypeError, ValueError) as error:
            raise InputError(f"status of a DFPC: {error}") from error


def frames_of(profile: Profile) -> frozenset[str]:
    """Frames that a mission has, whether or not a pose of them is known yet."""
    found = {"site"}
    for robot in profile.robots:
        found |= {f"{robot.id}/{name}" for name in (*_ROBOT_FRAMES, *robot.sensors)}
        found |= {sensor.frame for sensor in robot.sensors.values()}
        found |= {frame for edge in robot.frames for frame in (edge.parent, edge.child)}
    return frozenset(found)


def description_of(robot: Robot, entry: DfpcEntry, description: DfpcDescription) -> dict[str, Any]:
    """What ``dfpc/@rpc/describe`` says of a DFPC beside its state: what it is, needs, costs and achieves."""
    return {
        "name": entry.name,
        "robot": robot.id,
        "doc": description.doc,
        "version": description.version,
        "implementation": entry.implementation or description.implementations[0].name,
        "implementations": [
            {
                "name": i.name,
                "doc": i.doc,
                "cost": description.cost[i.name].model_dump() if i.name in description.cost else None,
                "performance": description.performance[i.name].model_dump()
                if i.name in description.performance
                else None,
            }
            for i in description.implementations
        ],
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
        "modes": robot.modes_of(entry),
        "activation": entry.activation,
        "linger_s": entry.linger_s,
        "warm_up_s": entry.warm_up_s,
        "resolution_m": _resolution_m(entry, description),
        "accuracy": description.accuracy,
        "cost": {k: c.model_dump() for k, c in description.cost.items()},
    }


def _resolution_m(entry: DfpcEntry, description: DfpcDescription) -> float | None:
    set_m = entry.parameters.get("resolution_m")
    if isinstance(set_m, (int, float)) and set_m > 0:
        return float(set_m)
    known = description.performance.get(entry.implementation or description.implementations[0].name)
    return None if known is None else known.resolution_m


def maker_of(
    description: Mapping[str, Any],
    *,
    alive: bool,
    active: bool,
    why_not: str = "",
    measured: Measured | None = None,
    rates_hz: Mapping[SensorId, float | None] | None = None,
    wired: Mapping[str, str] | None = None,
) -> Maker:
    """Return the maker that a description is of.

    Parameters
    ----------
    description : mapping
        As ``description_of``.
    alive, active, why_not
        As ``Maker`` has them.
    measured : Measured, optional
        What its status said last.
    rates_hz : mapping of SensorId to float, optional
        Samples a second of the sensors, in the modes that matter to it.
    wired : mapping of str to str, optional
        What feeds its ports now, as wiring.

    Raises
    ------
    InputError
        If a field is missing or malformed: the description came over the network.
    """
    try:
        robot = str(description["robot"])
        inputs = tuple(
            Input(str(i["port"]), _sources(robot, str(i["source"])), bool(i["optional"])) for i in description["inputs"]
        )
        cpu_s, memory_mb = _cost(description, measured)
        cpu = None if cpu_s is None else cpu_s * _rate_hz(inputs, rates_hz or {})
        if active and measured is not None and measured.load > 0.0:
            cpu = measured.load
        now = {port: source for port, text in (wired or {}).items() for source in _sources(robot, text)}
        resolution_m = description.get("resolution_m")
        return Maker(
            MakerId(robot, str(description["name"])),
            outputs={str(o["port"]): (str(o["product"]) or None) for o in description["outputs"]},
            inputs=inputs,
            modes={str(s): str(m) for s, m in description["modes"].items()},
            implementation=str(description["implementation"]),
            cost=_UNKNOWN_COST if cpu is None else cpu,
            cpu=cpu or 0.0,
            memory_mb=memory_mb,
            ready_s=float(description.get("warm_up_s", 0.0)) + (measured.latency_s if measured else cpu_s or 0.0),
            resolution_m=None if resolution_m is None else float(resolution_m),
            available=alive,
            active=active,
            wired=now if active else {},
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
    priority: int = -1,
    measured: Mapping[MakerId, Measured] | None = None,
) -> World:
    """The world as it is now, for a request of some priority.

    Parameters
    ----------
    profile, descriptions, observed, leases, refused
    hopeful : bool
        Whether every known DFPC counts as available, its process answering or not.
    priority : int
        Sensors held by lower ones may be taken; by default by nobody's.
    measured : mapping of MakerId to Measured, optional
    """
    makers = {}
    rates_hz = _rates_hz(profile, observed)
    for maker_id, description in descriptions.items():
        attempt = observed.attempts.get(maker_id)
        why = attempt.reason if attempt is not None and attempt.reason else "its process is not there"
        makers[maker_id] = maker_of(
            description,
            alive=hopeful or maker_id in observed.alive,
            active=maker_id in observed.active,
            why_not=why,
            measured=(measured or {}).get(maker_id),
            rates_hz=_rates_needed(profile, maker_id.robot, description, rates_hz),
            wired=observed.wired.get(maker_id),
        )
    sensors = {}
    for robot in profile.robots:
        for name, sensor in robot.sensors.items():
            sensor_id = SensorId(robot.id, name)
            current = observed.modes.get(sensor_id, sensor.initial_mode)
            held = leases.held_mode(sensor_id)
            firm = leases.serving(sensor_id, priority)
            sensors[sensor_id] = SensorState(
                sensor_id,
                {m: mode.on for m, mode in sensor.modes.items()},
                current,
                held,
                firm if firm is not None or held is None else frozenset(sensor.modes),
                leases.serving(sensor_id),
                refused.get(sensor_id, frozenset()),
                observed.lost.get(sensor_id, ""),
                {m: sum(s for _, s in way) for m in sensor.modes if (way := sensor.way(current, m)) is not None}
                if current in sensor.modes
                else {},
            )
    reserved = frozenset(leases.wanted | observed.active) & makers.keys()
    return World(
        makers,
        sensors,
        _left(profile, "memory_mb", {m: makers[m].memory_mb for m in reserved}),
        _left(profile, "cpu_cores", {m: makers[m].cpu for m in reserved}),
        reserved,
    )


def _left(profile: Profile, limit: str, taken: Mapping[MakerId, float]) -> dict[str, float]:
    """What the robots that state a limit have left of it."""
    return {
        robot.id: robot.limits[limit] - sum(x for m, x in taken.items() if m.robot == robot.id)
        for robot in profile.robots
        if limit in robot.limits
    }


def _rates_hz(profile: Profile, observed: Observed) -> dict[SensorId, float | None]:
    """Samples a second of each sensor in the mode it is in, or would be brought into to stream."""
    rates: dict[SensorId, float | None] = {}
    for robot in profile.robots:
        for name, sensor in robot.sensors.items():
            mode = sensor.modes.get(observed.modes.get(SensorId(robot.id, name), sensor.initial_mode))
            streaming = [m for m in (mode, *sensor.modes.values()) if m is not None and m.on]
            rates[SensorId(robot.id, name)] = streaming[0].rate_hz if streaming else None
    return rates


def _rates_needed(
    profile: Profile, robot: str, description: Mapping[str, Any], rates_hz: Mapping[SensorId, float | None]
) -> dict[SensorId, float | None]:
    """The same for one DFPC: where it needs modes, the fastest of them."""
    rates = dict(rates_hz)
    for name, modes in dict(description.get("modes", {})).items():
        sensor = profile.robot(robot).sensors.get(str(name))
        if sensor is not None:
            known = [sensor.modes[m].rate_hz for m in str(modes).split("|") if m in sensor.modes]
            rates[SensorId(robot, str(name))] = max((r for r in known if r is not None), default=None)
    return rates


def _rate_hz(inputs: tuple[Input, ...], rates_hz: Mapping[SensorId, float | None]) -> float:
    """Samples a second that reach a maker: of each wired input its fastest source."""
    total = 0.0
    for port in inputs:
        of_sensors = [rates_hz.get(SensorId(s.robot, s.owner)) for s in port.sources if s.kind == "sensor"]
        if of_sensors:
            total += max(_UNKNOWN_RATE_HZ if r is None else r for r in of_sensors)
    return total or _UNKNOWN_RATE_HZ


def feeds_of(
    world: World, feeding: Mapping[MakerId, Mapping[str, str]] | None = None
) -> dict[MakerId, frozenset[MakerId]]:
    """Which makers feed which: as plans chose, else as wired."""
    found: dict[MakerId, frozenset[MakerId]] = {}
    for m in world.makers.values():
        chosen = (feeding or {}).get(m.id)
        sources = [
            s
            for port in m.inputs
            for s in port.sources
            if chosen is None or (port.port in chosen and s.wiring == chosen[port.port])
        ]
        found[m.id] = frozenset(MakerId(s.robot, s.owner) for s in sources if s.kind == "product")
    return found


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
    """Sources of a wiring, as ``DfpcEntry.inputs`` of a profile has them; several are ``|``-separated."""
    sources = []
    for text in wiring.split("|") if wiring else ():
        kind, owner, item = text.split("/")
        if kind not in ("sensor", "product", "dpm"):
            raise ValueError(f"source {text!r}: expected sensor/…, product/… or dpm/…")
        sources.append(Source(kind, robot, owner, item))
    return tuple(sources)


def _cost(description: Mapping[str, Any], measured: Measured | None) -> tuple[float | None, float]:
    """CPU seconds of a sample and megabytes: measured, or as declared for its implementation, else for the dearest.

    None and 0 where neither is known.
    """
    costs = description.get("cost", {})
    declared = [costs[i] for i in [description["implementation"]] if i in costs] or list(costs.values())
    cpu_s = max((float(c["cpu_s"]) / int(c.get("samples", 1)) for c in declared), default=None)
    if measured is not None and measured.samples >= _ENOUGH_SAMPLES:
        cpu_s = measured.cpu_s
    return cpu_s, max((float(c["memory_mb"]) for c in declared), default=0.0)
