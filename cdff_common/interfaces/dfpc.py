# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The interface of a Data Fusion Processing Compound: samples in, products out, a local store, operations."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from cdff_common.errors import ConfigurationError, InputError, ProductNotFoundError
from cdff_common.geometry import FrameGraph
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.dfn import Dfn, StrictModel, validated
from cdff_common.interfaces.product import Quality
from cdff_common.interfaces.registry import Registry


class DfpcConfig(StrictModel):
    """Parameters of a DFPC. A field named like a DFN slot holds that DFN's parameters as a mapping."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One value arriving at an input port.

    Attributes
    ----------
    port : str
    stamp_ns : int
        End of capture, mission time, nanoseconds.
    seq : int
        Of its producer and stream.
    value : Any
        A ``cdff_common.types`` object.
    id : str
        Of the sample or product: what an output's ``inputs`` names.
    frame, child : str
        Of the sample's header; empty where it has none.
    """

    port: str
    stamp_ns: int
    seq: int
    value: Any
    id: str = ""
    frame: str = ""
    child: str = ""
    quality: Quality = field(default_factory=Quality)


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """One result of a step, before the run time gives it its identity.

    Attributes
    ----------
    port : str
        Output port of the description.
    value : Any
        A ``cdff_common.types`` object of the port's type; None if and only if ``quality.status`` is FAILED.
    t0_ns, t1_ns : int
        Begin and end of capture of what it was made from, nanoseconds.
    frame : str
        Frame of the values; for a pose the parent.
    child : str or None
        For a pose the child.
    inputs : tuple of str
        Ids of the samples it was made from.
    """

    port: str
    value: Any
    t0_ns: int
    t1_ns: int
    frame: str
    child: str | None = None
    quality: Quality = field(default_factory=Quality)
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class DfpcContext:
    """What a DFPC knows of where it runs.

    Attributes
    ----------
    robot : str
        Robot id; the prefix of the robot's frames.
    frames : FrameGraph
        The robot's fixed frames: ``{robot}/base`` to each sensor, ``site`` to ``{robot}/odom`` at the start.
    limits : mapping of str to float
        What the rover can do: ``max_slope_deg``, ``max_step_m``, ``width_m``, … as the profile states.
    sensors : mapping of str to mapping
        Each sensor's entry of the profile (frame, calibration).
    seed : int
        For every random number drawn.
    urdf : str
        Document of the robot's internal joints; empty where it has none.
    """

    robot: str
    frames: FrameGraph = field(default_factory=FrameGraph)
    limits: Mapping[str, float] = field(default_factory=dict)
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seed: int = 0
    urdf: str = ""


class LocalStore:
    """A DFPC's local data store: named items, each a callable that makes the current value when asked.

    Items are declared in ``product_management`` of the description and queried by other DFPCs and the DPM under
    ``store/{item}``.
    """

    def __init__(self) -> None:
        self._items: dict[str, Callable[[], Any]] = {}

    def offer(self, item: str, value: Callable[[], Any]) -> None:
        """Let ``item`` be asked for; ``value`` returns a ``cdff_common.types`` object or None."""
        self._items[item] = value

    @property
    def items(self) -> tuple[str, ...]:
        """Names that can be asked for."""
        return tuple(sorted(self._items))

    def get(self, item: str) -> Any:
        """Return the current value of an item; raises ProductNotFoundError where there is none yet."""
        if item not in self._items:
            raise ProductNotFoundError(f"store item {item!r}: this DFPC offers {', '.join(self.items) or 'none'}")
        value = self._items[item]()
        if value is None:
            raise ProductNotFoundError(f"store item {item!r} holds nothing yet")
        return value


class Dfpc(ABC):
    """An arrangement of DFNs with its controller and local store.

    Subclasses are generated interfaces that add one ``on_<port>`` per input port and one method per operation; the
    compound implements those. No clock, socket or file: time comes with the samples.
    """

    Config: ClassVar[type[DfpcConfig]] = DfpcConfig
    #: Folder name below ``cdff_core/dfpcs``.
    name: ClassVar[str]

    config: Any
    context: DfpcContext
    description: DfpcDescription
    implementation: str

    def configure(
        self,
        config: DfpcConfig | Mapping[str, Any] | None = None,
        context: DfpcContext | None = None,
        implementation: str | None = None,
    ) -> None:
        """Validate the configuration, make and configure every DFN, allocate.

        Raises
        ------
        ConfigurationError
            On an unknown key, a value out of bounds, or an implementation that the description does not list.
        """
        self.description = Registry.default().dfpc(self.name)
        self.implementation = implementation or self.description.implementations[0].name
        if self.implementation not in [i.name for i in self.description.implementations]:
            known = ", ".join(i.name for i in self.description.implementations)
            raise ConfigurationError(f"{self.name}: implementation {implementation!r}, expected one of {known}")
        if config is None or isinstance(config, Mapping):
            variant = next(i for i in self.description.implementations if i.name == self.implementation)
            config = {**variant.parameters, **(config or {})}
        self.config = validated(self.Config, config, self.name)
        self.context = context or DfpcContext(robot="robot")
        self.store = LocalStore()
        self.setup()

    def dfn(self, dfn_id: str) -> Dfn[Any, Any, Any]:
        """Make and configure the DFN of a slot, as implementation and configuration say."""
        variant = next(i for i in self.description.implementations if i.name == self.implementation)
        slot = next((d for d in variant.dfns if d.dfn_id == dfn_id), None)
        if slot is None:
            known = ", ".join(d.dfn_id for d in variant.dfns)
            raise ConfigurationError(f"{self.name}: no DFN slot {dfn_id!r} in {self.implementation}; it has {known}")
        node = Registry.default().make_dfn(slot.name, slot.implementation)
        parameters = getattr(self.config, dfn_id, None)
        node.configure({**slot.parameters, **(dict(parameters) if parameters else {})})
        return node

    @property
    def config_hash(self) -> str:
        """First 16 hex digits of the SHA-256 of name, implementation, version, parameters and seed."""
        resolved = {
            "name": self.name,
            "implementation": self.implementation,
            "version": self.description.version,
            "config": self.config.model_dump(mode="json"),
            "seed": self.context.seed,
        }
        return hashlib.sha256(json.dumps(resolved, sort_keys=True).encode()).hexdigest()[:16]

    @abstractmethod
    def setup(self) -> None:
        """Make the DFNs and offer the store items; called by ``configure``, and again by ``reset``."""

    @abstractmethod
    def step(self, sample: Sample) -> Iterable[Output]:
        """Take one sample, in time order, and return what it leads to."""

    #: Grows with every change of what ``state`` returns.
    state_revision: int = 0

    def state(self) -> Any:
        """Return what must survive a restart, a ``cdff_common.types`` object; None where nothing must."""
        return None

    def resume(self, state: Any) -> None:
        """Take up what ``state`` returned before a restart; called after ``configure``.

        Raises
        ------
        InputError
            If this DFPC keeps no state, or none of this type.
        """
        raise InputError(f"{self.name}: got a state of type {type(state).__name__}, expected none")

    def finish(self) -> Iterable[Output]:
        """Return what is still owed when the input ends or the DFPC is deactivated."""
        return ()

    def reset(self) -> None:
        """Forget all samples, keep the configuration."""
        self.store = LocalStore()
        self.setup()

    def call(self, operation: str, parameters: Mapping[str, str]) -> Any:
        """Run an operation of the description with its parameters as text.

        Raises
        ------
        ProductNotFoundError
            If the description has no such operation.
        InputError
            On an unknown, missing or malformed parameter.
        """
        known = {op.name: op for op in self.description.operations}
        if operation not in known:
            raise ProductNotFoundError(
                f"{self.name} has no operation {operation!r}; it has {', '.join(known) or 'none'}"
            )
        spec = known[operation]
        unknown = set(parameters) - {p.name for p in spec.inputs}
        if unknown:
            raise InputError(f"{self.name}.{operation}: unknown parameter {sorted(unknown)[0]!r}")
        values: dict[str, Any] = {}
        for p in spec.inputs:
            if p.name in parameters:
                values[p.name] = p.parse(parameters[p.name])
            elif p.default is None:
                raise InputError(f"{self.name}.{operation}: parameter {p.name} ({p.type}) is missing")
            else:
                values[p.name] = p.parse(p.default)
        return getattr(self, operation)(**values)
