# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""World of the planner as plain data: providers (DFPCs on robots), their input sources, sensors and modes."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from cdff_core.orchestration.accuracy import Accuracy
from cdff_core.orchestration.acquisition import Acquisition
from cdff_core.orchestration.adjustment import Adjustable
from cdff_core.orchestration.budgets import Amounts


class ProviderId(NamedTuple):
    """A DFPC on a robot."""

    robot: str
    dfpc: str

    def __str__(self) -> str:
        return f"{self.robot}/{self.dfpc}"


class SensorId(NamedTuple):
    """A sensor on a robot."""

    robot: str
    sensor: str

    def __str__(self) -> str:
        return f"{self.robot}/{self.sensor}"


class InputSource(NamedTuple):
    """Source of an input port: a sensor stream, an output port of a DFPC, or a product stored in the DPM.

    ``kind`` is sensor, product or dpm; ``owner`` is the sensor, the DFPC or the robot of the stored product;
    ``item`` is the stream, the output port or the product.
    """

    kind: str
    robot: str
    owner: str
    item: str

    def __str__(self) -> str:
        return f"{self.kind}/{self.robot}/{self.owner}/{self.item}"

    @property
    def wiring(self) -> str:
        """Text form in a profile, without the robot."""
        return f"{self.kind}/{self.owner}/{self.item}"


@dataclass(frozen=True, slots=True)
class Input:
    """An input port with its wiring in the profile."""

    port: str
    #: Alternative sources, of which one is used; empty if the port is not wired.
    sources: tuple[InputSource, ...]
    optional: bool = False  # true if the DFPC also works without it


@dataclass(frozen=True, slots=True)
class Provider:
    """A DFPC on a robot with its outputs, inputs and cost."""

    id: ProviderId
    outputs: Mapping[str, str | None]  # output port to its product; None for an internal stream
    inputs: tuple[Input, ...] = ()
    #: Sensor of the same robot to the required modes, alternatives separated by ``|``.
    modes: Mapping[str, str] = field(default_factory=dict)
    implementation: str = ""
    cost: float = 1.0  # cost in the comparison of plans, usually CPU seconds per second
    cpu: float = 0.0  # CPU load on its robot, CPU seconds per second
    memory_mb: float = 0.0
    power_w: float = 0.0  # power of its CPU load, watts, which becomes heat
    data_mb_h: float = 0.0  # volume of its stored products, megabytes per hour
    ready_s: float = 0.0  # time from activation to reliable output, seconds
    resolution_m: float | None = None  # resolution of its product; None if not declared
    available: bool = True  # true if its process answers and it can be activated
    active: bool = False  # true if it is running, so that its use adds no cost
    #: Current source of each port while active; another source costs ``REWIRE_COST``.
    wired: Mapping[str, InputSource] = field(default_factory=dict)
    unavailable_reason: str = ""  # reason why it is not available
    adjustables: tuple[Adjustable, ...] = ()  # parameters that requests adjust
    accuracy: Accuracy | None = None  # described accuracy of its product; None if not described
    sensor_products: frozenset[str] = frozenset()  # products that are poses of a sensor, not of the base
    #: The same DFPC with other implementations that a plan may select.
    alternatives: tuple[Provider, ...] = ()

    @property
    def choices(self) -> tuple[Provider, ...]:
        """The provider and its alternatives."""
        return (self, *self.alternatives)

    @property
    def finest_m(self) -> float | None:
        """Finest resolution of its product that a request can have; None if not declared."""
        least = [a.least for a in self.adjustables if a.follows == "resolution_m"]
        return self.resolution_m if self.resolution_m is None else min(self.resolution_m, *least, math.inf)

    @property
    def needs(self) -> dict[str, float]:
        """Needed part of each budget of its robot."""
        return {
            "memory_mb": self.memory_mb,
            "cpu_cores": self.cpu,
            "power_w": self.power_w,
            "heat_w": self.power_w,
            "data_mb_h": self.data_mb_h,
        }

    @property
    def products(self) -> frozenset[str]:
        """Products that can be requested from it."""
        return frozenset(p for p in self.outputs.values() if p is not None)


@dataclass(frozen=True, slots=True)
class SensorState:
    """State of a sensor for the planner."""

    id: SensorId
    modes: Mapping[str, bool]  # mode to whether the sensor streams in it
    current: str  # current mode
    held: str | None = None  # mode required by a lease; None if the mode may change
    #: If held: modes that serve all holders of at least the priority of the request. None: only ``held``.
    priority_modes: frozenset[str] | None = None
    #: If held: modes that serve all holders; any other takes the sensor from holders of lower priority. None:
    #: the same as ``priority_modes``.
    shared_modes: frozenset[str] | None = None
    #: Modes that the instrument control unit refused or did not confirm, with the reason.
    refused: Mapping[str, str] = field(default_factory=dict)
    lost: str = ""  # reason why the sensor is unavailable; empty otherwise
    #: Time to reach each mode from the current one, seconds; others cannot be reached. Empty: unknown.
    switch_s: Mapping[str, float] = field(default_factory=dict)
    #: Needed part of each budget of its robot, by mode.
    needs: Mapping[str, Amounts] = field(default_factory=dict)
    #: Possible single acquisitions for the request, by mode.
    acquisitions: Mapping[str, Acquisition] = field(default_factory=dict)

    def obstacle(self, mode: str) -> str | None:
        """Return the reason why the sensor cannot be used in ``mode``; None if it can."""
        if self.lost:
            return f"sensor {self.id} is lost: {self.lost}"
        if mode not in self.modes:
            return f"sensor {self.id} has no mode {mode}"
        allowed = frozenset({self.held}) if self.priority_modes is None else self.priority_modes
        if self.held is not None and mode not in allowed:
            return f"sensor {self.id} is kept in mode {self.held} by another request"
        if mode in self.refused and mode != self.current:
            return self.refused[mode]
        if self.switch_s and mode not in self.switch_s:
            return f"sensor {self.id} cannot switch from mode {self.current} to {mode}"
        return None

    def takes_from_others(self, mode: str) -> bool:
        """Return whether ``mode`` would take the sensor from holders of lower priority."""
        shared = self.priority_modes if self.shared_modes is None else self.shared_modes
        return self.held is not None and shared is not None and mode not in shared

    @property
    def reserved_needs(self) -> Amounts:
        """Needs in the mode that a lease requires, else in the current mode, by budget."""
        return self.needs.get(self.held or self.current, {})

    def added_needs(self, mode: str) -> dict[str, float]:
        """Return the difference of the needs in ``mode`` and the reserved needs, by budget."""
        now = self.reserved_needs
        return {budget: value - now.get(budget, 0.0) for budget, value in self.needs.get(mode, {}).items()}

    def streaming_modes(self) -> tuple[str, ...]:
        """Return the streaming modes: the held mode, the current mode, then the others as in the profile."""
        named = dict.fromkeys(m for m in (self.held, self.current, *self.modes) if m is not None)
        return tuple(m for m in named if self.modes.get(m))


@dataclass(frozen=True, slots=True)
class World:
    """Providers, sensors and budgets that a plan may use."""

    providers: Mapping[ProviderId, Provider]
    sensors: Mapping[SensorId, SensorState] = field(default_factory=dict)
    #: Robot to the free part of each of its budgets, next to the ``reserved`` providers and the reserved
    #: needs of sensors.
    free: Mapping[str, Amounts] = field(default_factory=dict)
    #: Providers with allocated budgets: running providers, and those in plans of other requests.
    reserved: frozenset[ProviderId] = frozenset()
    #: Reserved providers that the request may stop, with the priority of their requests.
    takeable: Mapping[ProviderId, int] = field(default_factory=dict)
    _outputs: dict[tuple[str, str], list[tuple[Provider, str]]] = field(
        init=False, default_factory=dict, compare=False, repr=False
    )
    #: Products with a plan, by robot; the planner fills it.
    possible: dict[str, tuple[str, ...]] = field(init=False, default_factory=dict, compare=False, repr=False)
    #: Plans, or the reasons if there is none, by the arguments of the planner, which fills it.
    plans: dict[Hashable, Any] = field(init=False, default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        for provider in self.providers.values():
            for port, product in sorted(provider.outputs.items()):
                if product is not None:
                    self._outputs.setdefault((provider.id.robot, product), []).append((provider, port))

    def choice(self, provider_id: ProviderId, implementation: str | None) -> Provider:
        """Return a provider with an implementation, by default with the current one."""
        provider = self.providers[provider_id]
        return next((c for c in provider.choices if c.implementation == implementation), provider)

    def outputs_of(self, product: str, robots: Iterable[str]) -> list[tuple[Provider, str]]:
        """Return the providers of a product on some robots, each with its output port."""
        return [output for robot in robots for output in self._outputs.get((robot, product), ())]

    def products_of(self, robot: str) -> set[str]:
        """Return the products of a robot."""
        return {product for owner, product in self._outputs if owner == robot}
