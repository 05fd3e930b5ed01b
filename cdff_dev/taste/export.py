# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface and data view of TASTE from the description of a DFPC.

The DFPC is a function: its input ports are sporadic provided interfaces, its output ports required ones, its
operations unprotected provided ones. A second function, ``robot``, represents what sends the inputs and takes
the outputs, so that the view is complete.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from cdff_common.interfaces.description import DfpcDescription, OperationInput
from cdff_dev.taste.aadl import Component, Item, Package, Property, View, view_text
from cdff_dev.taste.types_used import UsedType, used_types
from cdff_dev.taste.views import (
    Connection,
    Function,
    Interface,
    InterfaceView,
    Parameter,
    interface_packages,
)

#: The function of the sensors and users of the products.
ROBOT = "robot"
_SCALARS = {"float": "T-Double", "int": "T-Int64", "string": "T-String", "bool": "T-Boolean"}
_KINDS = {
    "SEQUENCE": "aSEQUENCE",
    "SEQUENCE OF": "aSEQUENCEOF",
    "ENUMERATED": "aENUMERATED",
    "CHOICE": "aCHOICE",
    "INTEGER": "aINTEGER",
    "REAL": "aREAL",
    "BOOLEAN": "aBOOLEAN",
    "OCTET STRING": "aOCTETSTRING",
}
_BUFFER = "Stream_Element_Buffer"


def taste_files(description: DfpcDescription) -> dict[str, str]:
    """Return the files of a DFPC by name: both views, and the ASN.1 modules of its types."""
    types = used_types(type_names(description))
    name = description.folder
    data_file = f"{name}_dv.aadl"
    modules = {t.path.name: t.path.read_text(encoding="utf-8") for t in types}
    return {
        f"{name}_iv.aadl": view_text(interface_packages(dfpc_view(description, data_file))),
        data_file: view_text(data_view(types)),
        **dict(sorted(modules.items())),
    }


def type_names(description: DfpcDescription) -> list[str]:
    """Return the ASN.1 types of the ports and operations of a DFPC."""
    names = [port.type_name for port in (*description.input_ports, *description.output_ports)]
    for operation in description.operations:
        names += [_SCALARS[i.type] for i in operation.inputs]
        if operation.output_type != "void":
            names.append(_SCALARS.get(operation.output_type, operation.output_type))
    return list(dict.fromkeys(names))


def dfpc_view(description: DfpcDescription, data_file: str) -> InterfaceView:
    """Return the interface view of a DFPC."""
    name = description.folder
    inputs = [(p.attribute, _parameter("sample", p.type_name)) for p in description.input_ports]
    outputs = [(p.attribute, _parameter("product", p.type_name)) for p in description.output_ports]
    own = [Interface(port, True, (p,), "sporadic") for port, p in inputs]
    # An output may have the name of an input, and the features of a function differ in their prefix only.
    own += [Interface(port, False, (p,)) for port, p in outputs]
    others = [Interface(port, False, (p,)) for port, p in inputs]
    others += [Interface(port, True, (p,), "sporadic") for port, p in outputs]
    connections = [Connection((ROBOT, f"RI_{port}"), (name, f"PI_{port}")) for port, _ in inputs]
    connections += [Connection((name, f"RI_{port}"), (ROBOT, f"PI_{port}")) for port, _ in outputs]
    ports = {port for port, _ in (*inputs, *outputs)}
    for operation in description.operations:
        call = operation.name if operation.name not in ports else f"{operation.name}_call"
        parameters = tuple(_call_parameter(i) for i in operation.inputs)
        if operation.output_type != "void":
            result = _SCALARS.get(operation.output_type, operation.output_type)
            parameters += (_parameter("result", result, is_output=True),)
        own.append(Interface(call, True, parameters, "unprotected"))
        others.append(Interface(call, False, parameters))
        connections.append(Connection((ROBOT, f"RI_{call}"), (name, f"PI_{call}")))
    functions = (Function(name, tuple(own)), Function(ROBOT, tuple(others), "GUI"))
    return InterfaceView(functions, tuple(connections), data_file)


def _parameter(name: str, type_name: str, *, is_output: bool = False) -> Parameter:
    return Parameter(name, type_name.replace("-", "_"), is_output)


def _call_parameter(parameter: OperationInput) -> Parameter:
    return _parameter(parameter.name, _SCALARS[parameter.type])


def data_view(types: Iterable[UsedType]) -> View:
    """Return the data view of types, as ``asn2aadl`` writes it: sizes of messages and buffers."""
    types = list(types)
    files = {t.path.name: t.path for t in types}
    sums = [
        f"InputASN1FileChecksum:{hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()}:{name}:"
        for name, path in sorted(files.items())
    ]
    character = Property("Data_Model::Data_Representation", "Character")
    components = [Component("data", _BUFFER, properties=(character,))]
    for used in types:
        components += _type_components(used)
    imports = ("Data_Model", "Taste", "Base_Types", "Deployment")
    package = Package("DataView", imports, tuple(components))
    return View((package,), ("File generated by cdff generate taste: DO NOT EDIT !", *sums))


def _type_components(used: UsedType) -> tuple[Component, ...]:
    """Return the components of a type: itself, and the buffer of its messages with their length."""
    name, size = used.aadl_name, used.buffer_bytes
    properties = (
        Property("Source_Text", f'("{used.path.name}")'),
        Property("TASTE::Ada_Package_Name", f'"{used.module.replace("-", "_")}"'),
        Property("Deployment::ASN1_Module_Name", f'"{used.module}"'),
        Property("Source_Language", "(ASN1)"),
        Property("Source_Data_Size", f"{size} Bytes"),
        Property("Type_Source_Name", f'"{used.name}"'),
        Property("TASTE::ASN1_Basic_Type", _KINDS[used.kind]),
    )
    array = (
        Property("Data_Model::Data_Representation", "array"),
        Property("Data_Model::Dimension", f"({size})"),
        Property("Data_Model::Base_Type", f"(classifier (DataView::{_BUFFER}))"),
    )
    parts = (
        Item("Buffer", f"data {name}_Buffer_Max.impl"),
        Item("Length", "data Base_Types::Unsigned_32"),
    )
    structure = (Property("Data_Model::Data_Representation", "Struct"),)
    return (
        Component("data", name, properties=properties),
        Component("data", f"{name}.impl", is_implementation=True),
        Component("data", f"{name}_Buffer_Max"),
        Component("data", f"{name}_Buffer_Max.impl", is_implementation=True, properties=array),
        Component("data", f"{name}_Buffer"),
        Component(
            "data", f"{name}_Buffer.impl", is_implementation=True, subcomponents=parts, properties=structure
        ),
    )
