# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface of a Data Fusion Processing Compound: samples in, products out, local store, operations."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pydantic import Field, create_model

from cdff_common.errors import ConfigurationError, InputError, ProductNotFoundError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.dfn import Dfn, StrictModel, validated
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance


class DfpcConfig(StrictModel):
    """Parameters of a DFPC; ``Dfpc.config_model`` adds a field for the parameters of each DFN slot."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Value at an input port.

    Attributes
    ----------
    port : str
    stamp_ns : int
        End of capture, mission time, nanoseconds.
    seq : int
        Sequence number of its producer and stream.
    value : Any
        A ``cdff_common.types`` object.
    id : str
        Id of the sample or product, used in ``inputs`` of an output.
    frame, child : str
        Frames in the header of the sample; empty if it has none.
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
    """Result of a step, before the runtime assigns its id.

    Attributes
    ----------
    port : str
        Output port of the description.
    value : Any
        A ``cdff_common.types`` object of the port's type; None if and only if ``quality.status`` is FAILED.
    t0_ns, t1_ns : int
        Start and end of capture of the source data, nanoseconds.
    frame : str
        Frame of the values; for a pose the parent.
    child : str or None
        For a pose the child.
    inputs : tuple of str
        Ids of the source samples; empty and repeated ones are removed.
    """

    port: str
    value: Any
    t0_ns: int
    t1_ns: int
    frame: str
    child: str | None = None
    quality: Quality = field(default_factory=Quality)
    inputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "inputs", tuple(dict.fromkeys(i for i in self.inputs if i)))

    @classmethod
    def of_pose(
        cls,
        port: str,
        T: UncertainTransform | None,
        *,
        stamp_ns: int,
        frame: str,
        child: str,
        quality: Quality,
        inputs: tuple[str, ...] = (),
        producer: str = "",
        t0_ns: int | None = None,
    ) -> Output:
        """Return the output of a pose ``T_frame_child`` at ``stamp_ns``; without a value if it is FAILED."""
        value = None
        if T is not None and quality.status is not Status.FAILED:
            value = TransformWithCovariance.from_transform(
                T, parent=frame, child=child, stamp_ns=stamp_ns, producer=producer
            )
        return cls(port, value, stamp_ns if t0_ns is None else t0_ns, stamp_ns, frame, child, quality, inputs)


@dataclass(frozen=True, slots=True)
class DfpcContext:
    """Environment of a DFPC.

    Attributes
    ----------
    robot : str
        Robot id, the prefix of the robot's frames.
    frames : FrameGraph
        Fixed frames of the robot: ``{robot}/base`` to each sensor, ``site`` to ``{robot}/odom`` at the start.
    limits : mapping of str to float
        Limits of the rover in the profile: ``max_slope_deg``, ``max_step_m``, ``width_m``, ….
    sensors : mapping of str to mapping
        Entry of each sensor in the profile.
    seed : int
        Seed of all random numbers.
    urdf : str
        URDF document of the robot's joints; empty if it has none.
    """

    robot: str
    frames: FrameGraph = field(default_factory=FrameGraph)
    limits: Mapping[str, float] = field(default_factory=dict)
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seed: int = 0
    urdf: str = ""

    def sensor_frame(self, name: str, *kinds: str) -> str:
        """Return the frame of a sensor of one of some kinds.

        It is ``{robot}/{name}`` or, if the tree has no such frame, that of the first sensor of these kinds in
        the profile, so that a robot can name its frames as it likes.
        """
        default = f"{self.robot}/{name}"
        if default in self.frames.frames:
            return default
        frames = (str(s["frame"]) for s in self.sensors.values() if s.get("kind") in kinds and "frame" in s)
        return next((frame for frame in frames if frame in self.frames.frames), default)


class LocalStore:
    """Local data store of a DFPC: named items, each a callable that returns the current value.

    Items are declared in ``product_management`` of the description and queried by other DFPCs and the DPM
    under ``store/{item}``.
    """

    def __init__(self) -> None:
        self._items: dict[str, Callable[[], Any]] = {}

    def offer(self, item: str, value: Callable[[], Any]) -> None:
        """Add an item to the store; ``value()`` returns its ``cdff_common.types`` object, None if it is empty."""
        self._items[item] = value

    @property
    def items(self) -> tuple[str, ...]:
        """Names of the items."""
        return tuple(sorted(self._items))

    def get(self, item: str) -> Any:
        """Return the current value of an item; raises ProductNotFoundError if there is none yet."""
        if item not in self._items:
            raise ProductNotFoundError(
                f"store item {item!r}: this DFPC offers {', '.join(self.items) or 'none'}"
            )
        value = self._items[item]()
        if value is None:
            raise ProductNotFoundError(f"store item {item!r} is still empty")
        return value


class Dfpc(ABC):
    """Compound of DFNs with its controller and local store.

    Subclasses are generated interfaces that add one ``on_<port>`` per input port and one method per
    operation; the compound implements those. It has no clock, socket or file: time is the stamp of
    the sample.
    """

    Config: ClassVar[type[DfpcConfig]] = DfpcConfig
    #: Folder name below ``cdff_core/dfpcs``.
    name: ClassVar[str]
    #: Input ports; each has a handler ``on_<port>``.
    INPUT_PORTS: ClassVar[tuple[str, ...]] = ()

    config: Any
    context: DfpcContext
    description: DfpcDescription
    implementation: str

    @classmethod
    def config_model(cls) -> type[DfpcConfig]:
        """Return ``Config`` with one more field per DFN slot of the description: a mapping of parameters."""
        variants = Registry.default().dfpc(cls.name).implementations
        slots = {slot.dfn_id: slot.name for variant in variants for slot in variant.dfns}
        fields: dict[str, Any] = {
            dfn_id: (dict[str, Any], Field({}, description=f"Parameters of {name}"))
            for dfn_id, name in slots.items()
        }
        return create_model(cls.Config.__name__, __base__=cls.Config, **fields)

    def configure(
        self,
        config: Mapping[str, Any] | None = None,
        context: DfpcContext | None = None,
        implementation: str | None = None,
    ) -> None:
        """Validate the configuration, create and configure all DFNs, allocate.

        Raises
        ------
        ConfigurationError
            If a key or the implementation is unknown, or a value is out of bounds.
        """
        self.description = Registry.default().dfpc(self.name)
        self.implementation = implementation or self.description.implementations[0].name
        variants = {variant.name: variant for variant in self.description.implementations}
        if self.implementation not in variants:
            raise ConfigurationError(
                f"{self.name}: implementation {implementation!r}, expected one of {', '.join(variants)}"
            )
        self._slots = {slot.dfn_id: slot for slot in variants[self.implementation].dfns}
        parameters = {**variants[self.implementation].parameters, **(config or {})}
        self.config = validated(self.config_model(), parameters, self.name)
        self.context = context or DfpcContext(robot="robot")
        self.store = LocalStore()
        self.setup()

    def slot_parameters(self, dfn_id: str) -> dict[str, Any]:
        """Return the parameters of the configuration for the DFN of a slot."""
        return dict(getattr(self.config, dfn_id))

    def dfn(self, dfn_id: str, **defaults: Any) -> Dfn[Any, Any, Any]:
        """Return a new DFN of a slot; ``defaults`` are overridden by the description, then by the
        configuration.
        """
        slot = self._slots.get(dfn_id)
        if slot is None:
            slots = ", ".join(self._slots)
            raise ConfigurationError(
                f"{self.name}: no DFN slot {dfn_id!r} in {self.implementation}; it has {slots}"
            )
        node = Registry.default().make_dfn(slot.name, slot.implementation)
        node.configure({**defaults, **slot.parameters, **self.slot_parameters(dfn_id)})
        return node

    @property
    def covariance_kind(self) -> CovarianceKind:
        """Kind of the covariances: calibrated only if the description names a record on real data."""
        is_calibrated = self.implementation in self.description.calibrated
        return CovarianceKind.CALIBRATED if is_calibrated else CovarianceKind.FORMAL

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
        """Create the DFNs and the store items; called by ``configure`` and by ``reset``."""

    def step(self, sample: Sample) -> Iterable[Output]:
        """Pass one sample, in time order, to the handler of its port and return the outputs.

        Raises
        ------
        InputError
            If there is no such port, or the sample is malformed.
        """
        if sample.port not in self.INPUT_PORTS:
            raise InputError(
                f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}"
            )
        handler: Callable[[Sample], Iterable[Output]] = getattr(self, f"on_{sample.port}")
        return handler(sample)

    #: Increases with every change of the result of ``state``.
    state_revision: int = 0

    def state(self) -> Any:
        """Return the state for a restart, a ``cdff_common.types`` object, or None."""
        return None

    def resume(self, state: Any) -> None:
        """Restore the result of ``state`` after a restart; called after ``configure``.

        Raises
        ------
        InputError
            If this DFPC has no state, or a state of another type.
        """
        raise InputError(f"{self.name}: got a state of type {type(state).__name__}, expected none")

    def finish(self) -> Iterable[Output]:
        """Return the pending outputs when the input ends or the DFPC is deactivated."""
        return ()

    def reset(self) -> None:
        """Clear all samples, keep the configuration."""
        self.store = LocalStore()
        self.setup()

    def call(self, operation: str, parameters: Mapping[str, str]) -> Any:
        """Run an operation of the description with its parameters as text.

        Raises
        ------
        ProductNotFoundError
            If the description has no such operation.
        InputError
            If a parameter is unknown, missing or malformed.
        """
        operations = {op.name: op for op in self.description.operations}
        if operation not in operations:
            raise ProductNotFoundError(
                f"{self.name} has no operation {operation!r}; it has {', '.join(operations) or 'none'}"
            )
        declared = operations[operation]
        unknown = set(parameters) - {p.name for p in declared.inputs}
        if unknown:
            raise InputError(f"{self.name}.{operation}: unknown parameter {sorted(unknown)[0]!r}")
        values: dict[str, Any] = {}
        for p in declared.inputs:
            if p.name in parameters:
                values[p.name] = p.parse(parameters[p.name])
            elif p.default is None:
                raise InputError(f"{self.name}.{operation}: parameter {p.name} ({p.type}) is missing")
            else:
                values[p.name] = p.parse(p.default)
        return getattr(self, operation)(**values)
