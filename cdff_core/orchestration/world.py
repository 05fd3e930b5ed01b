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
    """A stream that can feed an input: of a sensor (``kind`` sensor) or of a DFPC (``kind`` product).

    ``owner`` is the sensor or DFPC, ``item`` its stream or output port.
    """

    kind: str
    robot: str
    owner: str
    item: str

    def __str__(self) -> str:
        return f"{self.kind}/{self.robot}/{self.owner}/{self.item}"


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
        Sensor of the same robot to the mode it needs while active.
    cost : float
        CPU seconds per second, or whatever one number plans are compared by.
    memory_mb : float
    available : bool
        Whether its process answers and would activate.
    active : bool
        Whether it runs already, so that using it costs nothing more.
    why_not : str
        Where it is not available: the reason.
    """

    id: MakerId
    outputs: Mapping[str, str | None]
    inputs: tuple[Input, ...] = ()
    modes: Mapping[str, str] = field(default_factory=dict)
    implementation: str = ""
    cost: float = 1.0
    memory_mb: float = 0.0
    available: bool = True
    active: bool = False
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
    refused : frozenset of str
        Modes the instrument control unit would not set.
    """

    id: SensorId
    modes: Mapping[str, bool]
    current: str
    held: str | None = None
    refused: frozenset[str] = frozenset()

    def obstacle(self, mode: str) -> str | None:
        """Why the sensor cannot be relied on in ``mode``; None where it can."""
        if mode not in self.modes:
            return f"sensor {self.id} has no mode {mode}"
        if self.held is not None and self.held != mode:
            return f"sensor {self.id} is kept in mode {self.held} by another request"
        if mode in self.refused and mode != self.current:
            return f"sensor {self.id} refused mode {mode}"
        return None

    def streaming_mode(self) -> str | None:
        """The mode to have samples in where none is named: the one it is in or kept in, else the first that streams."""
        for mode in (self.held, self.current, *self.modes):
            if mode is not None and self.modes.get(mode) and self.obstacle(mode) is None:
                return mode
        return None


@dataclass(frozen=True, slots=True)
class World:
    """All that a plan may use.

    Attributes
    ----------
    makers, sensors
    memory_free_mb : mapping of str to float
        Robot to the memory that is left for DFPCs besides those ``reserved``; absent ones have no budget.
    reserved : frozenset of MakerId
        Makers whose memory is taken already: they run, or somebody's plan holds them.
    """

    makers: Mapping[MakerId, Maker]
    sensors: Mapping[SensorId, SensorState] = field(default_factory=dict)
    memory_free_mb: Mapping[str, float] = field(default_factory=dict)
    reserved: frozenset[MakerId] = frozenset()
