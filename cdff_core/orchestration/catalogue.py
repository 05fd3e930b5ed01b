# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""World of the planner, from DFPC descriptions, measured resource usage and the mission profile."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.contract.wiring import Wiring, mode_names
from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.profile import DfpcEntry, Profile, Robot
from cdff_core.orchestration.accuracy import Accuracy
from cdff_core.orchestration.acquisition import acquisitions_of
from cdff_core.orchestration.adjustment import adjustables_of
from cdff_core.orchestration.budgets import BUDGET_UNITS, Amounts, added
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import (
    Input,
    InputSource,
    Provider,
    ProviderId,
    SensorId,
    SensorState,
    World,
)

#: Frame of missions in orbit with the axes of the GCRF.
_INERTIAL = "inertial"
#: Frames of every robot, and the origin of its visual odometry.
_ROBOT_FRAMES = ("base", "odom", "vo")
#: Assumed rate of a stream without a stated rate, Hz.
_UNKNOWN_RATE_HZ = 1.0
#: Assumed cost of a provider without a declared or measured one.
_UNKNOWN_COST = 1.0
#: Megabytes per hour in a byte per second.
_MB_H_PER_B_S = 3600.0 / 1e6
#: Samples after which measured values replace declared ones.
_ENOUGH_SAMPLES = 20


@dataclass(frozen=True, slots=True)
class ResourceUsage:
    """Resource usage reported in the status of a DFPC."""

    samples: int  # number of samples since configuration
    cpu_s: float  # mean CPU time of a sample
    load: float  # CPU seconds per second since the previous status; 0 while inactive
    latency_s: float  # duration of the last step
    memory_mb: float  # memory of the process
    stored_bytes: int  # size of the products for the DPM since the start of the process
    data_mb_h: float  # volume of these products since the previous status, megabytes per hour

    def describe(self) -> dict[str, float]:
        """Return plain data for the catalogue."""
        return {k: round(float(v), 6) for k, v in asdict(self).items()}

    @classmethod
    def of(cls, status: Mapping[str, Any], previous: ResourceUsage | None, since_s: float) -> ResourceUsage:
        """Return the usage in a status; raises InputError. ``previous`` is the usage ``since_s`` ago."""
        try:
            samples, cpu_s = int(status.get("samples", 0)), float(status.get("mean_step_cpu_s", 0.0))
            latency_s, memory_mb = float(status.get("last_step_s", 0.0)), float(status.get("rss_mb", 0.0))
            stored_bytes = int(status.get("stored_bytes", 0))
            load, data_mb_h = 0.0, 0.0
            if previous is not None and since_s > 0.0 and samples > previous.samples:
                load = (samples * cpu_s - previous.samples * previous.cpu_s) / since_s
                data_mb_h = max(stored_bytes - previous.stored_bytes, 0) / since_s * _MB_H_PER_B_S
            return cls(samples, cpu_s, max(load, 0.0), latency_s, memory_mb, stored_bytes, data_mb_h)
        except (TypeError, ValueError) as error:
            raise InputError(f"status of a DFPC: {error}") from error


def frames_of(profile: Profile) -> frozenset[str]:
    """Return the names of all frames of a mission."""
    frames = {"site"}
    if profile.orbit is not None:
        frames |= {_INERTIAL, *(f"{client}/body" for client in profile.orbit.clients)}
        frames |= {f"{robot.id}/lvlh" for robot in profile.robots}
    for robot in profile.robots:
        frames |= {f"{robot.id}/{name}" for name in (*_ROBOT_FRAMES, *robot.sensors)}
        frames |= {sensor.frame for sensor in robot.sensors.values()}
        frames |= {frame for edge in robot.frames for frame in (edge.parent, edge.child)}
    return frozenset(frames)


def description_of(robot: Robot, entry: DfpcEntry, description: DfpcDescription) -> dict[str, Any]:
    """Return the description of a DFPC on a robot: ports, modes, cost and performance."""
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
                "optional": p.optional and p.attribute not in entry.required_inputs,
                "source": entry.inputs.get(p.attribute, ""),
            }
            for p in description.input_ports
        ],
        "outputs": [
            {
                "port": p.attribute,
                "type": p.type_name,
                "product": p.product or "",
                "of_sensor": p.of_sensor,
            }
            for p in description.output_ports
        ],
        "modes": robot.modes_of(entry),
        "activation": entry.activation,
        "linger_s": entry.linger_s,
        "warm_up_s": entry.warm_up_s,
        "resolution_m": _resolution_m(entry, description),
        "choices": list(entry.choices(description)),
        "adjustable": [
            {**a.model_dump(exclude={"default"}), "configured": configured}
            for a in description.adjustable
            if (configured := entry.parameters.get(a.parameter, a.default)) is not None
        ],
        "data_mb_h": entry.data_mb_h,
        "power_w_per_core": robot.power_w_per_core,
        "accuracy": description.accuracy,
        "cost": {k: c.model_dump() for k, c in description.cost.items()},
    }


def _resolution_m(entry: DfpcEntry, description: DfpcDescription) -> float | None:
    """Return the configured resolution of a DFPC, else the declared one, else None."""
    configured_m = entry.parameters.get("resolution_m")
    if isinstance(configured_m, (int, float)) and configured_m > 0:
        return float(configured_m)
    performance = description.performance.get(entry.implementation or description.implementations[0].name)
    return None if performance is None else performance.resolution_m


def provider_of(
    description: Mapping[str, Any],
    *,
    alive: bool,
    active: bool,
    unavailable_reason: str = "",
    measured: ResourceUsage | None = None,
    rates_hz: Mapping[SensorId, float | None] | None = None,
    wired: Mapping[str, str] | None = None,
    running: str | None = None,
    admitted: frozenset[str] | None = None,
) -> Provider:
    """Return the provider for a result of ``description_of``; raises InputError if a field is malformed.

    ``alive`` states that its process runs. ``rates_hz`` are the sample rates of the sensors in the required
    modes, ``wired`` the current source of each port, ``measured`` the usage in the last status. ``running``
    is the current implementation, by default that of the profile, and ``admitted`` are the implementations
    that serve other requests, by default all.
    """
    try:
        current = running or str(description["implementation"])
        names = [n for n in map(str, description.get("choices", ())) if admitted is None or n in admitted]
        if len(names) > 1 or (names and names != [current]):
            first, *others = (
                provider_of(
                    {**description, "implementation": name, "choices": ()},
                    alive=alive,
                    active=active and name == current,
                    unavailable_reason=unavailable_reason,
                    measured=measured if name == current else None,
                    rates_hz=rates_hz,
                    wired=wired,
                )
                for name in sorted(names, key=lambda name: name != current)
            )
            return replace(first, alternatives=tuple(others))
        robot = str(description["robot"])
        inputs = tuple(
            Input(str(i["port"]), _sources(robot, str(i["source"])), bool(i["optional"]))
            for i in description["inputs"]
        )
        cpu_s, memory_mb = _cost(description, measured)
        is_measured = measured is not None and measured.samples >= _ENOUGH_SAMPLES
        counted = inputs if is_measured else _counted_inputs(description, inputs)
        cpu = None if cpu_s is None else cpu_s * _rate_hz(counted, rates_hz or {})
        if active and measured is not None and measured.load > 0.0:
            cpu = measured.load
        current_sources = {
            port: source for port, text in (wired or {}).items() for source in _sources(robot, text)
        }
        resolution_m = description.get("resolution_m")
        data_mb_h = float(description.get("data_mb_h", 0.0))
        if active and measured is not None and measured.data_mb_h > 0.0:
            data_mb_h = measured.data_mb_h
        return Provider(
            ProviderId(robot, str(description["name"])),
            outputs={str(o["port"]): (str(o["product"]) or None) for o in description["outputs"]},
            inputs=inputs,
            modes={str(s): str(m) for s, m in description["modes"].items()},
            implementation=str(description["implementation"]),
            cost=_UNKNOWN_COST if cpu is None else cpu,
            cpu=cpu or 0.0,
            memory_mb=memory_mb,
            power_w=(cpu or 0.0) * float(description.get("power_w_per_core", 0.0)),
            data_mb_h=data_mb_h,
            ready_s=float(description.get("warm_up_s", 0.0))
            + (measured.latency_s if measured else cpu_s or 0.0),
            resolution_m=None if resolution_m is None else float(resolution_m),
            available=alive,
            active=active,
            wired=current_sources if active else {},
            unavailable_reason=unavailable_reason,
            adjustables=adjustables_of(description),
            accuracy=_described_accuracy(description),
            sensor_products=frozenset(
                str(o["product"]) for o in description["outputs"] if o.get("of_sensor", False)
            ),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"description of a DFPC: {type(error).__name__} {error}") from error


def world_of(
    profile: Profile,
    descriptions: Mapping[ProviderId, Mapping[str, Any]],
    observed: ObservedState,
    leases: Leases,
    refused: Mapping[SensorId, Mapping[str, str]],
    *,
    optimistic: bool = False,
    priority: int = -1,
    measured: Mapping[ProviderId, ResourceUsage] | None = None,
    absent: Container[ProviderId] = frozenset(),
    cache: ProviderCache | None = None,
    robots: Container[str] | None = None,
    acquire: AcquisitionParameters | None = None,
) -> World:
    """Return the current world for a request of a priority, only of ``robots`` if they are given.

    ``descriptions`` are those of these robots, ``cache`` the providers of earlier calls.

    ``refused`` are the modes that the instrument control unit refused or did not confirm, with the reason.
    With ``optimistic``, every DFPC of the profile counts as available, also without a running process, except
    ``absent`` ones, whose robot has left or no longer has them. A request may take sensors, memory and CPU
    from requests of lower ``priority``, by default from none. ``acquire`` are the parameters of a single
    acquisition: sensors with a mode for it do not stream then.
    """
    providers = {}
    cache = ProviderCache() if cache is None else cache
    selected = [robot for robot in profile.robots if robots is None or robot.id in robots]
    rates_hz = {robot.id: _rates_hz(robot, observed) for robot in selected}
    robot_by_id = {robot.id: robot for robot in selected}
    for provider_id, description in descriptions.items():
        history = observed.failures.get(provider_id)
        reason = history.reason if history is not None and history.reason else "its process is not running"
        is_absent = provider_id in absent
        if is_absent:
            reason = f"it has left with robot {provider_id.robot}"
        providers[provider_id] = cache.provider_of(
            robot_by_id[provider_id.robot],
            description,
            alive=not is_absent and (optimistic or provider_id in observed.alive),
            active=provider_id in observed.active,
            unavailable_reason=reason,
            measured=(measured or {}).get(provider_id),
            rates_hz=rates_hz[provider_id.robot],
            wired=observed.wired.get(provider_id),
            running=observed.implementations.get(provider_id),
            admitted=leases.serving_implementations(provider_id, priority),
        )
    sensors = {}
    for robot in selected:
        for name, sensor in robot.sensors.items():
            sensor_id = SensorId(robot.id, name)
            current = observed.modes.get(sensor_id, sensor.initial_mode)
            held = leases.held_mode(sensor_id)
            serving = leases.serving_modes(sensor_id, priority)
            possible = (
                {}
                if acquire is None
                else acquisitions_of(sensor, acquire, observed.acquired.get(sensor_id, {}))
            )
            sensors[sensor_id] = SensorState(
                id=sensor_id,
                modes={
                    name: name in possible if possible else mode.streams
                    for name, mode in sensor.modes.items()
                },
                current=current,
                held=held,
                priority_modes=serving if serving is not None or held is None else frozenset(sensor.modes),
                shared_modes=leases.serving_modes(sensor_id),
                refused=refused.get(sensor_id, {}),
                lost=observed.lost.get(sensor_id, ""),
                switch_s=sensor.switch_durations_s.get(current, {}),
                needs=sensor.needs_by_mode,
                acquisitions=possible,
            )
    if acquire is not None:
        providers = {p: _with_acquisitions(provider, sensors) for p, provider in providers.items()}
    reserved = frozenset(p for p in providers if p in observed.active or leases.is_wanted(p))
    return World(
        providers,
        sensors,
        free=_free_budgets(selected, (providers[p] for p in reserved), sensors.values()),
        reserved=reserved,
        takeable={p: n for p in reserved if (n := leases.takeable(p, priority)) is not None},
    )


class ProviderCache:
    """Providers of earlier worlds; one is made again only if its description or an observation differs."""

    def __init__(self) -> None:
        self._providers: dict[
            tuple[ProviderId, bool], tuple[Mapping[str, Any], Robot, tuple[object, ...], Provider]
        ] = {}

    def provider_of(
        self,
        robot: Robot,
        description: Mapping[str, Any],
        *,
        alive: bool,
        rates_hz: Mapping[SensorId, float | None],
        **observations: Any,
    ) -> Provider:
        """Return ``provider_of`` for a DFPC of a robot with the ``rates_hz`` of its sensors."""
        key = (ProviderId(robot.id, str(description.get("name"))), alive)
        # Description and robot are compared by identity: a changed one is a new object.
        basis = (rates_hz, *observations.items())
        held = self._providers.get(key)
        if held is not None and held[0] is description and held[1] is robot and held[2] == basis:
            return held[3]
        rates = _rates_needed(robot, description, rates_hz)
        provider = provider_of(description, alive=alive, rates_hz=rates, **observations)
        self._providers[key] = (description, robot, basis, provider)
        return provider


def _with_acquisitions(provider: Provider, sensors: Mapping[SensorId, SensorState]) -> Provider:
    """Return a provider that also accepts the possible single acquisitions of the sensors with required
    modes.
    """
    modes = {
        name: "|".join((modes, *sensors[SensorId(provider.id.robot, name)].acquisitions))
        for name, modes in provider.modes.items()
        if SensorId(provider.id.robot, name) in sensors
    }
    if modes == dict(provider.modes):
        return provider
    alternatives = tuple(_with_acquisitions(other, sensors) for other in provider.alternatives)
    return replace(provider, modes={**provider.modes, **modes}, alternatives=alternatives)


def _free_budgets(
    robots: Iterable[Robot], reserved: Iterable[Provider], sensors: Iterable[SensorState]
) -> dict[str, dict[str, float]]:
    """Return the free budgets of each robot with limits, next to reserved providers and modes of sensors."""
    limits = {
        robot.id: own
        for robot in robots
        if (own := {budget: robot.limits[budget] for budget in BUDGET_UNITS if budget in robot.limits})
    }
    used: dict[str, list[Amounts]] = {robot: [] for robot in limits}
    for provider in reserved:
        if provider.id.robot in used:
            used[provider.id.robot].append(provider.needs)
    for state in sensors:
        if state.needs and state.id.robot in used:
            used[state.id.robot].append(state.reserved_needs)
    totals = {robot: added(amounts) for robot, amounts in used.items()}
    return {
        robot: {budget: limit - totals[robot].get(budget, 0.0) for budget, limit in own.items()}
        for robot, own in limits.items()
    }


def _rates_hz(robot: Robot, observed: ObservedState) -> dict[SensorId, float | None]:
    """Return the sample rate of each sensor in its current mode, or in its first streaming mode."""
    rates: dict[SensorId, float | None] = {}
    for name, sensor in robot.sensors.items():
        mode = sensor.modes.get(observed.modes.get(SensorId(robot.id, name), sensor.initial_mode))
        streaming = [m for m in (mode, *sensor.modes.values()) if m is not None and m.streams]
        rates[SensorId(robot.id, name)] = streaming[0].rate_hz if streaming else None
    return rates


def _rates_needed(
    robot: Robot, description: Mapping[str, Any], rates_hz: Mapping[SensorId, float | None]
) -> dict[SensorId, float | None]:
    """Return the sample rates for one DFPC; for a sensor with required modes that of the fastest one."""
    rates = dict(rates_hz)
    for name, modes in dict(description.get("modes", {})).items():
        sensor = robot.sensors.get(str(name))
        if sensor is not None:
            rates_in_modes = [sensor.modes[m].rate_hz for m in mode_names(str(modes)) if m in sensor.modes]
            rates[SensorId(robot.id, str(name))] = max(
                (r for r in rates_in_modes if r is not None), default=None
            )
    return rates


def _rate_hz(inputs: tuple[Input, ...], rates_hz: Mapping[SensorId, float | None]) -> float:
    """Return the samples per second of a provider: the rate of the fastest source, summed over its inputs."""
    total = 0.0
    for port in inputs:
        sensor_rates_hz = [
            rates_hz.get(SensorId(s.robot, s.owner)) for s in port.sources if s.kind == "sensor"
        ]
        if sensor_rates_hz:
            total += max(_UNKNOWN_RATE_HZ if r is None else r for r in sensor_rates_hz)
    return total or _UNKNOWN_RATE_HZ


def upstream_providers(
    world: World, chosen_sources: Mapping[ProviderId, Mapping[str, str]] | None = None
) -> dict[ProviderId, frozenset[ProviderId]]:
    """Return for each provider those that provide its inputs: the planned sources, else all wired ones."""
    return {
        provider.id: frozenset(
            ProviderId(s.robot, s.owner)
            for s in _selected_sources(provider, chosen_sources)
            if s.kind == "product"
        )
        for provider in world.providers.values()
    }


def sensors_used(
    world: World, chosen_sources: Mapping[ProviderId, Mapping[str, str]] | None = None
) -> dict[ProviderId, frozenset[SensorId]]:
    """Return for each provider the sensors whose samples (from planned, else all wired sources) or modes it
    needs.
    """
    return {
        provider.id: frozenset(
            {
                SensorId(s.robot, s.owner)
                for s in _selected_sources(provider, chosen_sources)
                if s.kind == "sensor"
            }
            | {SensorId(provider.id.robot, s) for s in provider.modes}
        )
        for provider in world.providers.values()
    }


def _selected_sources(
    provider: Provider, chosen_sources: Mapping[ProviderId, Mapping[str, str]] | None
) -> list[InputSource]:
    """Return the planned sources of a provider, else all wired ones."""
    selected = (chosen_sources or {}).get(provider.id)
    return [
        s
        for port in provider.inputs
        for s in port.sources
        if selected is None or (port.port in selected and s.wiring == selected[port.port])
    ]


@lru_cache(maxsize=4096)
def _sources(robot: str, wiring: str) -> tuple[InputSource, ...]:
    """Return the sources in a wiring of ``DfpcEntry.inputs``; alternatives are ``|``-separated."""
    sources = Wiring.parse(wiring).sources if wiring else ()
    return tuple(InputSource(s.kind, robot, s.owner, s.item) for s in sources)


def _counted_inputs(description: Mapping[str, Any], inputs: tuple[Input, ...]) -> tuple[Input, ...]:
    """Return the inputs whose samples have the declared cost."""
    cost = description.get("cost", {}).get(description["implementation"], {})
    ports = tuple(cost.get("ports", ()))
    return tuple(i for i in inputs if not ports or i.port in ports)


def _described_accuracy(description: Mapping[str, Any]) -> Accuracy | None:
    """Return the accuracy in the description of an implementation; None if it states none."""
    name = description["implementation"]
    variants = [v for v in description.get("implementations", ()) if v["name"] == name]
    performance = (variants[0].get("performance") if variants else None) or {}
    sigma_m, sigma_deg = performance.get("sigma_m"), performance.get("sigma_deg")
    return None if sigma_m is None and sigma_deg is None else Accuracy(sigma_m, sigma_deg)


def _cost(description: Mapping[str, Any], measured: ResourceUsage | None) -> tuple[float | None, float]:
    """Return CPU seconds per sample and memory in MB, measured or declared; None and 0 if unknown."""
    costs = description.get("cost", {})
    declared = [costs[i] for i in [description["implementation"]] if i in costs] or list(costs.values())
    cpu_s = max((float(c["cpu_s"]) / int(c.get("samples", 1)) for c in declared), default=None)
    if measured is not None and measured.samples >= _ENOUGH_SAMPLES:
        cpu_s = measured.cpu_s
    return cpu_s, max((float(c["memory_mb"]) for c in declared), default=0.0)
