# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What can be had, as plain data: makers (DFPCs on robots), the streams that feed them, sensors and their modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple


class MakerId(NamedTuple):
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


class Source(NamedTuple):
    """What can feed an input: a sensor (``kind`` sensor), a DFPC (product), or what the DPM holds (dpm).

    ``owner`` is the sensor, DFPC or the robot whose product it is, ``item`` its stream, output port or product.
    """

    kind: str
    robot: str
    owner: str
    item: str

    def __str__(self) -> str:
        return f"{self.kind}/{self.robot}/{self.owner}/{self.item}"

    @property
    def wiring(self) -> str:
        """As a profile writes it, within its robot."""
        return f"{self.kind}/{self.owner}/{self.item}"


@dataclass(frozen=True, slots=True)
class Input:
    """An input port as the mission wires it.

    Attributes
    ----------
    port : str
    sources : tuple of Source
        Alternatives; one of them feeds the port. Empty where the mission leaves it unwired.
    optional : bool
        Whether the DFPC also works without it.
    """

    port: str
    sources: tuple[Source, ...]
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Maker:
    """A DFPC on a robot: what it makes, from what, at what cost.

    Attributes
    ----------
    outputs : mapping of str to str or None
        Output port to the product it is to a requester, None for internal streams.
    modes : mapping of str to str
        Sensor of the same robot to the modes that serve it while active, ``|``-separated.
    cost : float
        CPU seconds per second, or whatever one number plans are compared by.
    cpu : float
        CPU seconds per second that it takes of its robot's cores.
    memory_mb : float
    ready_s : float
        From activation to what it makes may be relied on, seconds.
    resolution_m : float or None
        Of what it makes; None where that is not declared.
    available : bool
        Whether its process answers and would activate.
    active : bool
        Whether it runs already, so that using it costs nothing more.
    wired : mapping of str to Source
        While it is active: what feeds its ports now. Another source costs ``REWIRE_COST``.
    why_not : str
        Where it is not available: the reason.
    """

    id: MakerId
    outputs: Mapping[str, str | None]
    inputs: tuple[Input, ...] = ()
    modes: Mapping[str, str] = field(default_factory=dict)
    implementation: str = ""
    cost: float = 1.0
    cpu: float = 0.0
    memory_mb: float = 0.0
    ready_s: float = 0.0
    resolution_m: float | None = None
    available: bool = True
    active: bool = False
    wired: Mapping[str, Source] = field(default_factory=dict)
    why_not: str = ""

    @property
    def products(self) -> frozenset[str]:
        """The products a requester can get from it."""
        return frozenset(p for p in self.outputs.values() if p is not None)


@dataclass(frozen=True, slots=True)
class SensorState:
    """A sensor as the planner sees it.

    Attributes
    ----------
    modes : mapping of str to bool
        Mode to whether the sensor streams in it.
    current : str
        Mode it is in.
    held : str or None
        Mode that somebody's lease keeps it in; None where it is free to change.
    firm : frozenset of str or None
        Where it is held: the modes that serve all holders of at least our priority. None: only ``held``.
    kept : frozenset of str or None
        The modes that serve all its holders. None: as ``firm``. Another one takes the sensor from the lower ones.
    refused : frozenset of str
        Modes the instrument control unit would not set.
    lost : str
        Why it cannot be had at all; empty where it can.
    switch_s : mapping of str to float
        How long it takes to reach a mode from the current one, seconds; absent ones cannot be reached. Empty: unknown.
    """

    id: SensorId
    modes: Mapping[str, bool]
    current: str
    held: str | None = None
    firm: frozenset[str] | None = None
    kept: frozenset[str] | None = None
    refused: frozenset[str] = frozenset()
    lost: str = ""
    switch_s: Mapping[str, float] = field(default_factory=dict)

    def obstacle(self, mode: str) -> str | None:
        """Why the sensor cannot be relied on in ``mode``; None where it can."""
        if self.lost:
            return f"sensor {self.id} is lost: {self.lost}"
        if mode not in self.modes:
            return f"sensor {self.id} has no mode {mode}"
        if self.held is not None and mode not in (frozenset({self.held}) if self.firm is None else self.firm):
            return f"sensor {self.id} is kept in mode {self.held} by another request"
        if mode in self.refused and mode != self.current:
            return f"sensor {self.id} refused mode {mode}"
        if self.switch_s and mode not in self.switch_s:
            return f"sensor {self.id} has no way from mode {self.current} to {mode}"
        return None

    def takes_from_others(self, mode: str) -> bool:
        """Whether holders of lower priority would lose the sensor by ``mode``."""
        kept = self.firm if self.kept is None else self.kept
        return self.held is not None and kept is not None and mode not in kept

    def streaming_modes(self) -> tuple[str, ...]:
        """Modes to have samples in: the one it is kept in, the one it is in, then as the profile names them."""
        named = dict.fromkeys(m for m in (self.held, self.current, *self.modes) if m is not None)
        return tuple(m for m in named if self.modes.get(m))


@dataclass(frozen=True, slots=True)
class World:
    """All that a plan may use.

    Attributes
    ----------
    makers, sensors
    memory_free_mb : mapping of str to float
        Robot to the memory that is left for DFPCs besides those ``reserved``; absent ones have no budget.
    cpu_free : mapping of str to float
        The same of the robot's cores, CPU seconds per second.
    reserved : frozenset of MakerId
        Makers whose memory and CPU are taken already: they run, or somebody's plan holds them.
    """

    makers: Mapping[MakerId, Maker]
    sensors: Mapping[SensorId, SensorState] = field(default_factory=dict)
    memory_free_mb: Mapping[str, float] = field(default_factory=dict)
    cpu_free: Mapping[str, float] = field(default_factory=dict)
    reserved: frozenset[MakerId] = frozenset()
