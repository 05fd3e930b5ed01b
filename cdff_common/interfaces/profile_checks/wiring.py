# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Inputs of the DFPCs of a profile: ports, sources, their types, and required ports."""

from __future__ import annotations

from collections.abc import Iterator

from cdff_common.contract.products import product_types
from cdff_common.contract.wiring import Source, Wiring
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.description import DfpcDescription, InputPort
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.interfaces.profile_checks.faults import ABSENT, Finding, nearest_name, one_of, unknown_name
from cdff_common.interfaces.profile_checks.reading import Reading
from cdff_common.interfaces.profile_checks.references import message_types
from cdff_common.interfaces.registry import Registry
from cdff_common.interfaces.yaml_file import Location


def wiring_findings(reading: Reading) -> Iterator[Finding]:
    """Yield the findings of the inputs of every DFPC."""
    assert reading.profile is not None
    for i, robot in enumerate(reading.profile.robots):
        for j, entry in enumerate(robot.dfpcs):
            place: Location = ("robots", i, "dfpcs", j)
            description = description_of(entry.name)
            if description is None:
                yield _unknown_dfpc((*place, "name"), entry.name)
                continue
            yield from _entry_findings(reading, robot, entry, description, place)


def description_of(dfpc: str) -> DfpcDescription | None:
    """Return the description of a DFPC, None if there is none."""
    try:
        return Registry.default().dfpc(dfpc)
    except ConfigurationError:
        return None


def _unknown_dfpc(place: Location, name: str) -> Finding:
    registry = Registry.default()
    if name in registry.failures:
        return Finding(place, f"this DFPC did not load: {registry.failures[name]}", name)
    return unknown_name(place, name, "DFPC", sorted(registry.dfpcs))


def _entry_findings(
    reading: Reading, robot: Robot, entry: DfpcEntry, description: DfpcDescription, place: Location
) -> Iterator[Finding]:
    """Yield the findings about the implementation and the inputs of a DFPC."""
    ports = {port.attribute: port for port in description.input_ports}
    known = [variant.name for variant in description.implementations]
    if entry.implementation is not None and entry.implementation not in known:
        at = (*place, "implementation")
        yield unknown_name(at, entry.implementation, f"implementation of {entry.name}", known)
    for i, name in enumerate(entry.implementations):
        if name not in known:
            at = (*place, "implementations", i)
            yield unknown_name(at, name, f"implementation of {entry.name}", known)
    unknown = [port for port in entry.inputs if port not in ports]
    for port in unknown:
        free = [name for name in ports if name not in entry.inputs]
        problem = f"{entry.name} has no such input port; expected {one_of(ports)}"
        yield Finding((*place, "inputs", port), problem, ABSENT, nearest_name(port, free))
    for i, port in enumerate(entry.required_inputs):
        at = (*place, "required_inputs", i)
        if port not in entry.inputs and not reading.is_unreadable(*place, "inputs", port):
            yield unknown_name(at, port, f"input of {entry.name} with a source", list(entry.inputs))
    if not unknown:
        yield from _missing_ports(reading, entry, ports, place)
    for name, text in entry.inputs.items():
        for source in Wiring.parse(text).sources:
            if name in ports:
                yield from _source_findings(reading, robot, source, ports[name], (*place, "inputs", name))


def _missing_ports(
    reading: Reading, entry: DfpcEntry, ports: dict[str, InputPort], place: Location
) -> Iterator[Finding]:
    """Yield a finding for each required port without a source, and for a DFPC without any input."""
    for name, port in ports.items():
        is_absent = name not in entry.inputs and not reading.is_unreadable(*place, "inputs", name)
        if is_absent and not port.optional:
            problem = f"missing, {entry.name} requires this input ({port.type_name})"
            yield Finding((*place, "inputs", name), problem, ABSENT)
    if (
        not entry.inputs
        and not reading.is_unreadable(*place, "inputs")
        and ports
        and all(port.optional for port in ports.values())
    ):
        yield Finding((*place, "inputs"), f"empty, expected at least {one_of(ports)}", ABSENT)


def _source_findings(
    reading: Reading, robot: Robot, source: Source, port: InputPort, at: Location
) -> Iterator[Finding]:
    """Yield the finding of a source that does not exist or has another type than the port."""
    if source.kind == "sensor":
        if reading.is_unreadable(*at[:2], "sensors", source.owner, "streams", source.item):
            return
        if source.owner not in robot.sensors:
            yield _unknown_source(at, source, source.owner, f"sensor of {robot.id}", list(robot.sensors))
            return
        known_names = robot.sensors[source.owner].streams
        kind = f"stream of sensor {source.owner}"
    elif source.kind == "product":
        names = [entry.name for entry in robot.dfpcs]
        description = description_of(source.owner)
        if source.owner not in names:
            misspelt = [nearest_name(name, [source.owner]) for name in names if not description_of(name)]
            if source.owner not in misspelt and not _has_unreadable_dfpcs(reading, at):
                yield _unknown_source(at, source, source.owner, f"DFPC of {robot.id}", names)
            return
        if description is None:  # reported at its entry
            return
        known_names = {port.attribute: port.type_name for port in description.output_ports}
        kind = f"output port of {source.owner}"
    else:
        known_names = {name: product.type_name or "" for name, product in product_types().items()}
        kind = "product type"
    type_name = known_names.get(source.item)
    if type_name is None:
        yield _unknown_source(at, source, source.item, kind, list(known_names))
    elif type_name in message_types() and type_name != port.type_name:
        yield Finding(at, _type_problem(robot, source, port, type_name), str(source))


def _has_unreadable_dfpcs(reading: Reading, at: Location) -> bool:
    """Return True if an entry among the DFPCs of the robot of a location is not in the valid part."""
    dfpcs = (*reading.origin(at[:2]), "dfpcs")
    return any(r[: len(dfpcs)] == dfpcs and len(r) <= len(dfpcs) + 2 for r in reading.removed)


def _unknown_source(at: Location, source: Source, name: str, kind: str, known: list[str]) -> Finding:
    """Return the finding of an unknown part of a source, with the whole source as the nearest name."""
    nearest = nearest_name(name, known)
    suggestion = str(source).replace(f"/{name}", f"/{nearest}", 1) if nearest else ""
    return Finding(at, f"no {kind} {name!r}; expected {one_of(known)}", str(source), suggestion)


def _type_problem(robot: Robot, source: Source, port: InputPort, type_name: str) -> str:
    """Return the problem of a source of another type, with the sources of the right type."""
    fitting = [
        f"sensor/{name}/{stream}"
        for name, sensor in robot.sensors.items()
        for stream, offered in sensor.streams.items()
        if offered == port.type_name
    ]
    for entry in robot.dfpcs:
        description = description_of(entry.name)
        outputs = () if description is None else description.output_ports
        fitting += [f"product/{entry.name}/{o.attribute}" for o in outputs if o.type_name == port.type_name]
    sources = f"; sources of this type: {', '.join(fitting[:8])}" if fitting else ""
    return f"{source} has the type {type_name}, port {port.attribute} takes {port.type_name}{sources}"
