# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface view of TASTE: functions with provided and required interfaces, and their connections."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from cdff_common.errors import InputError
from cdff_dev.taste.aadl import Component, Item, Package, Property, View, parse_view, value_of

#: Package of the functions, as the editor of TASTE names it.
ROOT = "interfaceview::IV"
#: Kinds of operations of provided interfaces.
KINDS = ("sporadic", "cyclic", "protected", "unprotected", "any")

_PACKAGES = ("Taste", "DataView", "TASTE_IV_Properties")
_PERIOD = re.compile(r"([0-9.]+)\s*(ns|us|ms|sec|s)\Z", re.IGNORECASE)
_MS = {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3, "sec": 1e3}
_PARAMETER = re.compile(r"(IN|OUT) PARAMETER DataView::(\w+)\Z", re.IGNORECASE)
_ACCESS = re.compile(r"(PROVIDES|REQUIRES) SUBPROGRAM ACCESS (\S+)\Z", re.IGNORECASE)
_CONNECTION = re.compile(r"SUBPROGRAM ACCESS (\w+)\.(\w+) -> (\w+)\.(\w+)\Z", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of an interface.

    Attributes
    ----------
    type : str
        Name in the data view, e.g. ``Base_samples_RigidBodyState``.
    encoding : str
        ``NATIVE``, ``UPER`` or ``ACN``.
    """

    name: str
    type: str
    is_output: bool = False
    encoding: str = "UPER"


@dataclass(frozen=True, slots=True)
class Interface:
    """Provided or required interface of a function.

    Attributes
    ----------
    kind : str
        Of a provided interface: sporadic (a message), cyclic (a clock), protected or unprotected (a call).
    period_ms, deadline_ms : float
        0 for none.
    """

    name: str
    is_provided: bool
    parameters: tuple[Parameter, ...] = ()
    kind: str = "any"
    period_ms: float = 0.0
    deadline_ms: float = 0.0

    @property
    def feature(self) -> str:
        """Name of the feature: ``PI_scan``, ``RI_pose``."""
        return f"{'PI' if self.is_provided else 'RI'}_{self.name}"


@dataclass(frozen=True, slots=True)
class Function:
    """Function (block) of an interface view; ``language`` as TASTE names it, e.g. ``CPP``."""

    name: str
    interfaces: tuple[Interface, ...]
    language: str = "CPP"


@dataclass(frozen=True, slots=True)
class Connection:
    """Connection of a required interface with a provided one: names of function and interface for each."""

    required: tuple[str, str]
    provided: tuple[str, str]


@dataclass(frozen=True, slots=True)
class InterfaceView:
    """Functions and connections; ``data_view`` is the file of the types."""

    functions: tuple[Function, ...]
    connections: tuple[Connection, ...] = ()
    data_view: str = ""
    version: str = field(default="2.0", compare=False)


def read_interface_view(path: Path) -> InterfaceView:
    """Read a ``*_iv.aadl`` file; raises InputError."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text: {error}") from error
    return interface_view(parse_view(text, str(path)), str(path))


def interface_view(view: View, source: str) -> InterfaceView:
    """Return the functions of a parsed view; raises InputError if it is no interface view."""
    functions: list[Function] = []
    connections: list[Connection] = []
    data_view = ""
    for package in view.packages:
        calls = {c.name.lower(): c for c in package.components if c.category == "subprogram"}
        for component in package.components:
            if component.category != "system":
                continue
            if component.is_implementation:
                connections += _connections(component, source)
            elif component.features or component.value("Source_Language"):
                functions.append(_function(component, calls, source))
            data_view = data_view or re.sub(r'[()"]', "", component.value("Taste::dataViewPath") or "")
    if not functions:
        raise InputError(f"{source}: no function; expected the interface view of TASTE (*_iv.aadl)")
    known = {(f.name.lower(), i.feature.lower()) for f in functions for i in f.interfaces}
    for connection in connections:
        for name, feature in (connection.required, connection.provided):
            if (name.lower(), feature.lower()) not in known:
                raise InputError(f"{source}: a connection names {name}.{feature}, which no function has")
    return InterfaceView(tuple(functions), tuple(connections), data_view)


def _function(component: Component, calls: dict[str, Component], source: str) -> Function:
    interfaces = []
    for item in component.features:
        access = _ACCESS.match(item.content)
        if access is None:
            raise InputError(
                f"{source}: {component.name}.{item.name} is {item.content!r}, expected an interface: "
                "PROVIDES or REQUIRES SUBPROGRAM ACCESS"
            )
        is_provided = access[1].lower() == "provides"
        call = calls.get(item.name.lower())
        if call is None:
            raise InputError(f"{source}: {component.name}.{item.name}: its package has no such subprogram")
        prefix = "pi_" if is_provided else "ri_"
        interfaces.append(
            Interface(
                name=item.name[3:] if item.name.lower().startswith(prefix) else item.name,
                is_provided=is_provided,
                parameters=tuple(_parameter(p, source) for p in call.features),
                kind=(value_of(item.properties, "Taste::RCMoperationKind") or "any").lower(),
                period_ms=_milliseconds(value_of(item.properties, "Taste::RCMperiod"), source),
                deadline_ms=_milliseconds(value_of(item.properties, "Taste::Deadline"), source),
            )
        )
    language = (component.value("Source_Language") or "(CPP)").strip("() ")
    return Function(component.name, tuple(interfaces), language)


def _parameter(item: Item, source: str) -> Parameter:
    match = _PARAMETER.match(item.content)
    if match is None:
        raise InputError(
            f"{source}: parameter {item.name} is {item.content!r}, expected IN PARAMETER DataView::TYPE"
        )
    encoding = value_of(item.properties, "Taste::encoding") or "NATIVE"
    return Parameter(item.name, match[2], match[1].lower() == "out", encoding.upper())


def _milliseconds(text: str | None, source: str) -> float:
    if text is None:
        return 0.0
    match = _PERIOD.match(text)
    if match is None:
        raise InputError(f"{source}: time {text!r}, expected a number with ns, us, ms or sec")
    return float(match[1]) * _MS[match[2].lower()]


def _connections(component: Component, source: str) -> Iterator[Connection]:
    for item in component.connections:
        match = _CONNECTION.match(item.content)
        if match is None:
            raise InputError(
                f"{source}: connection {item.name} is {item.content!r}, expected A.PI_X -> B.RI_X"
            )
        yield Connection((match[3], match[4]), (match[1], match[2]))


def interface_packages(view: InterfaceView) -> View:
    """Return an interface view as packages of AADL, as the editor of TASTE writes them."""
    providers = {connection.required: connection.provided for connection in view.connections}
    packages = [_package(function, providers) for function in view.functions]
    data: tuple[Property, ...] = (Property("Taste::dataView", '("DataView")'),)
    if view.data_view:
        data += (Property("Taste::dataViewPath", f'("{view.data_view}")'),)
    systems = (
        Component("system", "interfaceview", properties=data),
        Component(
            "system",
            "interfaceview.others",
            is_implementation=True,
            subcomponents=tuple(
                Item(f.name, f"SYSTEM {ROOT}::{f.name}::{f.name}.others", _place(i))
                for i, f in enumerate(view.functions)
            ),
            connections=tuple(_connection_item(c) for c in view.connections),
        ),
    )
    imports = (*(f"{ROOT}::{f.name}" for f in view.functions), *_PACKAGES)
    end: tuple[Property, ...] = (*data, Property("Taste::coordinates", '"0 0 297000 210000"'))
    end += (Property("Taste::version", f'"{view.version}"'),)
    packages.append(Package(ROOT, imports, systems, end))
    notes = ("AADL2.1", "TASTE type interfaceview", "generated by cdff generate taste: do not edit")
    return View(tuple(packages), notes)


def _connection_item(connection: Connection) -> Item:
    (provider, provided), (user, required) = connection.provided, connection.required
    content = f"SUBPROGRAM ACCESS {provider}.{provided} -> {user}.{required}"
    return Item(f"{provider}_{provided}_{user}_{required}", content)


def _place(index: int) -> tuple[Property, ...]:
    """Return the place of a function in the drawing: boxes in a row, 0.01 mm."""
    left = 20_000 + 130_000 * index
    return (Property("Taste::coordinates", f'"{left} 40000 {left + 90_000} 160000"'),)


def _package(function: Function, providers: dict[tuple[str, str], tuple[str, str]]) -> Package:
    used = {
        providers[function.name, i.feature][0]
        for i in function.interfaces
        if (function.name, i.feature) in providers
    }
    components: list[Component] = []
    features: list[Item] = []
    for interface in function.interfaces:
        components += _subprogram(interface)
        features.append(_feature(function, interface, providers))
    language = Property("Source_Language", f"({function.language})")
    active = Property("Taste::Active_Interfaces", "any")
    components.append(
        Component("system", function.name, features=tuple(features), properties=(language, active))
    )
    components.append(Component("system", f"{function.name}.others", is_implementation=True))
    imports = (*(f"{ROOT}::{name}" for name in sorted(used - {function.name})), *_PACKAGES)
    return Package(f"{ROOT}::{function.name}", imports, tuple(components))


def _subprogram(interface: Interface) -> tuple[Component, Component]:
    """Return the type and the implementation of an interface."""
    parameters = tuple(
        Item(
            p.name,
            f"{'OUT' if p.is_output else 'IN'} PARAMETER DataView::{p.type}",
            (Property("Taste::encoding", p.encoding),),
        )
        for p in interface.parameters
    )
    queue: tuple[Property, ...] = ()
    times: tuple[Property, ...] = ()
    if interface.is_provided:
        queue = (Property("Taste::Associated_Queue_Size", "1"),)
        times = (Property("Compute_Execution_Time", "0 ms .. 0 ms"),)
    name = interface.feature
    return (
        Component("subprogram", name, features=parameters, properties=queue),
        Component("subprogram", f"{name}.others", is_implementation=True, properties=times),
    )


def _feature(
    function: Function, interface: Interface, providers: dict[tuple[str, str], tuple[str, str]]
) -> Item:
    """Return the feature of a function; a required interface refers to the one that is connected."""
    if interface.is_provided:
        access, (owner, target) = "PROVIDES", (function.name, interface.feature)
        times: tuple[Property, ...] = (
            Property("Taste::RCMperiod", f"{interface.period_ms:g} ms"),
            Property("Taste::Deadline", f"{interface.deadline_ms:g} ms"),
        )
    else:
        access, times = "REQUIRES", ()
        own = (function.name, interface.feature)
        owner, target = providers.get(own, own)
    properties = (
        Property("Taste::RCMoperationKind", interface.kind),
        *times,
        Property("Taste::InterfaceName", f'"{interface.name}"'),
    )
    content = f"{access} SUBPROGRAM ACCESS {ROOT}::{owner}::{target}.others"
    return Item(interface.feature, content, properties)
