# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions of DFNs and DFPCs: the models of ``dfn.yaml`` and ``dfpc.yaml``, validated on reading.

The DFN file contains the seven template fields of the paper (§2.1): generic description (``doc``), inputs and
outputs, parameters, estimated cost, dependencies, diagnostics, unit test. The file of the paper's Fig. 3
loads unchanged. The DFPC file contains Table 1: data flow (ports and DFNs), product management, control.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from cdff_common.contract.names import KEY_NAME
from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.array_ports import ARRAY_TYPE, SCALAR_TYPES
from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_common.interfaces.yaml_file import read_mapping

Identifier = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]


def snake_case(name: str) -> str:
    """Return the snake case form: ``Registration3D`` -> ``registration_3d``."""
    text = re.sub(r"([a-z])(\d+(?:[A-Z](?![a-z]))?)", r"\1_\2", name)
    text = re.sub(
        r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=\d)(?=[A-Z][a-z])|(?<=\d[A-Z])(?=[A-Z])", "_", text
    )
    return re.sub(r"_+", "_", text).lower()


class Port(StrictModel):
    """Input or output of a DFN or DFPC; ``values`` restricts the numbers of a DFN's input."""

    name: Identifier
    type: Annotated[str, Field(max_length=64)]
    doc: str = ""
    optional: bool = False
    values: Literal["any", "finite", "positive"] = "any"

    @property
    def attribute(self) -> str:
        """Python name of the port."""
        return snake_case(self.name)

    @property
    def type_name(self) -> str:
        """Type without the ``asn1Scc`` prefix of InFuse."""
        return self.type.removeprefix("asn1Scc")

    @property
    def is_message(self) -> bool:
        """True for a type of ``cdff_common.types``, False for an array or a scalar."""
        return self.type not in SCALAR_TYPES and ARRAY_TYPE.match(self.type) is None


class InputPort(Port):
    """Input of a DFPC.

    Attributes
    ----------
    ordered : bool
        Accept samples in ascending order of time only; otherwise drop only repeated ones.
    compared : bool
        Check while running that mount and clock of the sensor of this port agree with those of the sensors of
        the other compared ports (``cdff_core.consistency``).
    aliases : tuple of str
        Other names of the port on the command line.
    repeated : bool
        ``cdff run`` takes several files for the port, and passes them in their order before other ports.
    """

    ordered: bool = True
    compared: bool = False
    repeated: bool = False
    aliases: tuple[Identifier, ...] = ()


class OutputPort(Port):
    """Output of a DFPC with its product name in requests.

    Attributes
    ----------
    product : str or None
    absolute : bool
        Files of the trajectory contain the poses as they are, not relative to the first one.
    of_sensor : bool
        The pose is that of a sensor, not that of the base of the robot.
    """

    product: Annotated[str, Field(pattern=rf"^{KEY_NAME}$")] | None = None
    absolute: bool = False
    of_sensor: bool = False


class Cost(StrictModel):
    """Measured cost for a stated input, written by the benchmark; ``samples`` is the number of input samples.

    Samples of other ports than ``ports`` cost nothing; without ``ports`` those of all ports are counted.
    """

    input: str
    samples: Annotated[int, Field(ge=1)] = 1
    ports: tuple[Identifier, ...] = ()
    cpu_s: NonNegativeFloat
    memory_mb: NonNegativeFloat
    benchmark: str = ""


class Performance(StrictModel):
    """Performance of an implementation, for the catalogue and plans of the orchestrator.

    Attributes
    ----------
    resolution_m : float or None
        Default cell size or spacing of the product; a parameter ``resolution_m`` of the profile has priority.
    latency_s : float or None
        Time from the last required sample to the product, on the machine of the benchmark.
    sigma_m, sigma_deg : float or None
        Standard deviation of the product: position or elevation, metres; orientation, degrees.
    accuracy : str
        Error, with the data of its measurement.
    """

    sigma_m: PositiveFloat | None = None
    sigma_deg: PositiveFloat | None = None
    resolution_m: PositiveFloat | None = None
    latency_s: NonNegativeFloat | None = None
    accuracy: str = ""


class DfnDescription(StrictModel):
    """Content of ``dfn.yaml``.

    Attributes
    ----------
    aliases : tuple of str
        Other names of the DFN, and other names of its first implementation.
    implementation_aliases : dict
        Other names of implementations, e.g. ``OrbDescriptor: Orb``.
    """

    name: Identifier
    doc: str = ""
    version: str = "1"
    aliases: tuple[str, ...] = ()
    implementation_aliases: dict[str, Identifier] = {}
    implementations: tuple[Identifier, ...] = ()
    input_ports: tuple[Port, ...] = ()
    output_ports: tuple[Port, ...] = ()
    cost: dict[str, Cost] = {}
    dependencies: tuple[str, ...] = ()
    diagnostics: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()

    @property
    def folder(self) -> str:
        """Name of the folder and on the command line."""
        return snake_case(self.name)

    def implementation(self, name: str) -> str:
        """Return the implementation of a name, the first one for names of the DFN; raises
        ConfigurationError.
        """
        if name in self.implementations:
            return name
        if name in self.implementation_aliases:
            return self.implementation_aliases[name]
        if name in (self.name, self.folder, *self.aliases):
            return self.implementations[0]
        known = ", ".join([*self.implementations, *self.implementation_aliases])
        raise ConfigurationError(f"{self.name}: implementation {name!r}, expected one of {known}")


class DfnSlot(StrictModel):
    """DFN slot of a DFPC."""

    dfn_id: Identifier
    name: Identifier
    implementation: Identifier
    parameters: dict[str, Any] = {}


class DfpcImplementation(StrictModel):
    """Variant of a DFPC: the DFN implementations in its slots, and its parameter defaults."""

    name: Identifier
    doc: str = ""
    parameters: dict[str, Any] = {}
    dfns: tuple[DfnSlot, ...] = ()


class OperationInput(StrictModel):
    """Parameter of an operation."""

    name: Identifier
    type: Literal["float", "int", "string", "bool"]
    doc: str = ""
    default: str | None = None

    def parse(self, text: str) -> Any:
        """Parse the text of the parameter; raises InputError."""
        try:
            if self.type == "bool":
                return {"true": True, "false": False}[text.lower()]
            return {"float": float, "int": int, "string": str}[self.type](text)
        except (ValueError, KeyError) as error:
            raise InputError(f"parameter {self.name}={text!r}: expected a {self.type}") from error


class Operation(StrictModel):
    """Operation of a DFPC that clients can call."""

    name: Identifier
    doc: str
    output_type: str = "void"
    inputs: tuple[OperationInput, ...] = ()


class ManagedItem(StrictModel):
    """Item of "Data Product Management" in the paper: stored locally, and possibly sent to the DPM."""

    item: Identifier
    type: str
    doc: str
    push: Literal["output", "event", "query"] = "query"


class AdjustableParameter(StrictModel):
    """Parameter of a DFPC that requests set while it runs.

    Attributes
    ----------
    parameter : str
    follows : str
        Value of the request that sets it. ``resolution_m``: cell size; ``period_s``: period of a standing
        request; ``range_m``: distance to the farthest point of the region.
    default : float or None
        Value without the profile; None if it is not a number, and then the profile must state one.
    least, greatest : float
        Bounds of the adjustment.
    live : bool
        True if it takes effect at the next sample; otherwise the DFPC finishes its products and is configured
        again, with its state.
    """

    parameter: Identifier
    follows: Literal["resolution_m", "range_m", "period_s"]
    default: float | None = None
    least: PositiveFloat
    greatest: PositiveFloat
    live: bool = False


class DfpcDescription(StrictModel):
    """Content of ``dfpc.yaml``.

    Attributes
    ----------
    calibrated : mapping of str to str
        Implementations whose covariance agrees with ground truth on real data, with the record of
        ``docs/evaluation`` that shows it; the covariance of all others is ``formal``.
    adjustable : list of AdjustableParameter
        Parameters that requests set while it runs.
    """

    name: Identifier
    doc: str
    version: str = "1"
    aliases: tuple[str, ...] = ()
    track: Literal["orbital", "planetary"]
    input_ports: tuple[InputPort, ...]
    output_ports: tuple[OutputPort, ...]
    operations: tuple[Operation, ...] = ()
    implementations: Annotated[tuple[DfpcImplementation, ...], Field(min_length=1)]
    product_management: tuple[ManagedItem, ...] = ()
    control: tuple[str, ...]
    cost: dict[str, Cost] = {}
    performance: dict[str, Performance] = {}
    adjustable: tuple[AdjustableParameter, ...] = ()
    accuracy: str = ""
    calibrated: dict[str, Identifier] = {}
    tests: tuple[str, ...] = ()

    @property
    def folder(self) -> str:
        """Name of the folder and on the command line."""
        return snake_case(self.name)


def _check_unique(path: Path, subject: str, names: list[str]) -> None:
    repeated = sorted({n for n in names if names.count(n) > 1})
    if repeated:
        raise ConfigurationError(f"{path}: {subject} {repeated[0]!r} is repeated")


def read_dfn_description(path: Path) -> DfnDescription:
    """Read and validate a ``dfn.yaml``; raises ConfigurationError with file and key."""
    data = read_mapping(path)
    data.setdefault("implementations", [data.get("name")])
    description = validated(DfnDescription, data, str(path))
    ports = [*description.input_ports, *description.output_ports]
    for group in (description.input_ports, description.output_ports):
        _check_unique(path, "port", [p.attribute for p in group])
    _check_unique(path, "implementation", list(description.implementations))
    for port in ports:
        if "[" in port.type and not ARRAY_TYPE.match(port.type):
            raise ConfigurationError(
                f"{path}: port {port.name} has type {port.type!r}, expected e.g. float64[n,3]"
            )
    return description


def read_dfpc_description(path: Path) -> DfpcDescription:
    """Read and validate a ``dfpc.yaml``; raises ConfigurationError with file and key."""
    description = validated(DfpcDescription, read_mapping(path), str(path))
    for group in (description.input_ports, description.output_ports):
        _check_unique(path, "port", [p.attribute for p in group])
    _check_unique(path, "implementation", [i.name for i in description.implementations])
    names = {i.name for i in description.implementations}
    for table in (description.cost, description.performance, description.calibrated):
        for name in sorted(table.keys() - names):
            raise ConfigurationError(
                f"{path}: {name!r} is not an implementation; expected one of {', '.join(sorted(names))}"
            )
    for variant in description.implementations:
        _check_unique(path, f"DFN slot of {variant.name}", [d.dfn_id for d in variant.dfns])
    return description
