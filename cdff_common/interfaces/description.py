# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions of DFNs and DFPCs: one model of ``dfn.yaml`` and ``dfpc.yaml``, checked when it is read.

The DFN file carries the paper's seven template fields (§2.1): generic description (``doc``), inputs and outputs,
parameters, estimated cost, dependencies, diagnostics, unit test. The file of the paper's Fig. 3 loads unchanged.
The DFPC file carries Table 1: data flow (ports and DFNs), product management, control.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_common.interfaces.yaml_file import read_mapping

#: Array ports of DFNs: ``float64[n,3]``; anything else is the name of a type of ``cdff_common.types``.
ARRAY_TYPE = re.compile(r"(?P<dtype>float32|float64|uint8|uint16|int32|int64|bool)\[(?P<shape>[a-z0-9,+* ]*)\]\Z")
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")

Identifier = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]


def snake_case(name: str) -> str:
    """``LaserFilter`` to ``laser_filter``, ``Registration3D`` to ``registration_3d``."""
    text = re.sub(r"([a-z])(\d+(?:[A-Z](?![a-z]))?)", r"\1_\2", name)
    text = re.sub(
        r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=\d)(?=[A-Z][a-z])|(?<=\d[A-Z])(?=[A-Z])", "_", text
    )
    return re.sub(r"_+", "_", text).lower()


class Port(StrictModel):
    """An input or output of a DFN or DFPC."""

    name: Identifier
    type: Annotated[str, Field(max_length=64)]
    doc: str = ""
    optional: bool = False

    @property
    def attribute(self) -> str:
        """The Python name of the port."""
        return snake_case(self.name)

    @property
    def type_name(self) -> str:
        """The type without the original's ``asn1Scc`` prefix."""
        return self.type.removeprefix("asn1Scc")


class InputPort(Port):
    """An input of a DFPC.

    Attributes
    ----------
    ordered : bool
        Whether its samples are taken in rising order of time only; else older ones too, and only repeated ones are
        dropped.
    """

    ordered: bool = True


class OutputPort(Port):
    """An output of a DFPC: also says what it is to a requester."""

    product: str | None = None


class Parameter(StrictModel):
    """One parameter of a DFN; default and bounds are those of the implementation's Config."""

    name: Identifier
    doc: str
    unit: str = "1"
    implementations: tuple[str, ...] = ()


class Cost(StrictModel):
    """Measured cost for a stated input, as the benchmark wrote it; ``samples`` is of how many samples that is."""

    input: str
    samples: Annotated[int, Field(ge=1)] = 1
    cpu_s: Annotated[float, Field(ge=0)]
    memory_mb: Annotated[float, Field(ge=0)]
    benchmark: str = ""


class Performance(StrictModel):
    """What an implementation achieves: for the orchestrator's catalogue and plans.

    Attributes
    ----------
    resolution_m : float or None
        Cell or spacing of what it makes by default; a parameter ``resolution_m`` of the profile goes before it.
    latency_s : float or None
        From the last sample it needs to its product, on the machine of the benchmark.
    accuracy : str
        Error with the data it was measured on.
    """

    resolution_m: Annotated[float, Field(gt=0)] | None = None
    latency_s: Annotated[float, Field(ge=0)] | None = None
    accuracy: str = ""


class DfnDescription(StrictModel):
    """Contents of ``dfn.yaml``.

    Attributes
    ----------
    aliases : tuple of str
        Other names of the DFN, and names that its first implementation has elsewhere.
    implementation_aliases : dict
        Names that other implementations have elsewhere, and which of this DFN each is: ``OrbDescriptor: Orb``.
    """

    name: Identifier
    doc: str = ""
    version: str = "1"
    aliases: tuple[str, ...] = ()
    implementation_aliases: dict[str, Identifier] = {}
    implementations: tuple[Identifier, ...] = ()
    input_ports: tuple[Port, ...] = ()
    output_ports: tuple[Port, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    cost: dict[str, Cost] = {}
    dependencies: tuple[str, ...] = ()
    diagnostics: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()

    @property
    def folder(self) -> str:
        """Folder and command-line name."""
        return snake_case(self.name)

    def implementation(self, name: str) -> str:
        """The implementation of a name; the first one for the DFN's own names; raises ConfigurationError."""
        if name in self.implementations:
            return name
        if name in self.implementation_aliases:
            return self.implementation_aliases[name]
        if name in (self.name, self.folder, *self.aliases):
            return self.implementations[0]
        known = ", ".join([*self.implementations, *self.implementation_aliases])
        raise ConfigurationError(f"{self.name}: implementation {name!r}, expected one of {known}")


class DfnSlot(StrictModel):
    """A DFN used by a DFPC."""

    dfn_id: Identifier
    name: Identifier
    implementation: Identifier
    parameters: dict[str, Any] = {}


class DfpcImplementation(StrictModel):
    """One variant of a DFPC: which DFN implementations fill its slots, and its own defaults of the parameters."""

    name: Identifier
    doc: str = ""
    parameters: dict[str, Any] = {}
    dfns: tuple[DfnSlot, ...] = ()


class OperationInput(StrictModel):
    """A parameter of an operation."""

    name: Identifier
    type: Literal["float", "int", "string", "bool"]
    doc: str = ""
    default: str | None = None

    def parse(self, text: str) -> Any:
        """Turn the parameter's text into its value; raises InputError."""
        try:
            if self.type == "bool":
                return {"true": True, "false": False}[text.lower()]
            return {"float": float, "int": int, "string": str}[self.type](text)
        except (ValueError, KeyError) as error:
            raise InputError(f"parameter {self.name}={text!r}: expected a {self.type}") from error


class Operation(StrictModel):
    """Something a DFPC does on demand."""

    name: Identifier
    doc: str
    output_type: str = "void"
    inputs: tuple[OperationInput, ...] = ()


class ManagedItem(StrictModel):
    """A line of the paper's "Data Product Management": what is kept, and what of it goes to the DPM."""

    item: Identifier
    type: str
    doc: str
    push: Literal["output", "event", "query"] = "query"


class DfpcDescription(StrictModel):
    """Contents of ``dfpc.yaml``."""

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
    accuracy: str = ""
    tests: tuple[str, ...] = ()

    @property
    def folder(self) -> str:
        """Folder and command-line name."""
        return snake_case(self.name)


def _check_unique(path: Path, what: str, names: list[str]) -> None:
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise ConfigurationError(f"{path}: {what} {twice[0]!r} is named twice")


def read_dfn_description(path: Path) -> DfnDescription:
    """Read and check a ``dfn.yaml``; raises ConfigurationError naming file and key."""
    data = read_mapping(path)
    data.setdefault("implementations", [data.get("name")])
    description = validated(DfnDescription, data, str(path))
    ports = [*description.input_ports, *description.output_ports]
    for group in (description.input_ports, description.output_ports):
        _check_unique(path, "port", [p.attribute for p in group])
    _check_unique(path, "implementation", list(description.implementations))
    _check_unique(path, "parameter", [p.name for p in description.parameters])
    for port in ports:
        if "[" in port.type and not ARRAY_TYPE.match(port.type):
            raise ConfigurationError(f"{path}: port {port.name} has type {port.type!r}, expected as in float64[n,3]")
    return description


def read_dfpc_description(path: Path) -> DfpcDescription:
    """Read and check a ``dfpc.yaml``; raises ConfigurationError naming file and key."""
    description = validated(DfpcDescription, read_mapping(path), str(path))
    for group in (description.input_ports, description.output_ports):
        _check_unique(path, "port", [p.attribute for p in group])
    _check_unique(path, "implementation", [i.name for i in description.implementations])
    named = {i.name for i in description.implementations}
    for table in (description.cost, description.performance):
        for name in sorted(table.keys() - named):
            raise ConfigurationError(f"{path}: {name!r} is no implementation; there are {', '.join(sorted(named))}")
    for variant in description.implementations:
        _check_unique(path, f"DFN slot of {variant.name}", [d.dfn_id for d in variant.dfns])
    return description
