# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Component of GenoM3 from the description of a DFPC.

Ports have the type ``asn1::bitstream`` of the package ``infuse-idl``, as in the components of LAAS for
InFuse. The ROS template of GenoM3 publishes them as ``infuse_msgs/asn1_bitstream``, which the gateway to ROS 1 reads
and writes.
"""

from __future__ import annotations

from collections.abc import Iterator

from cdff_common.interfaces.description import DfpcDescription, Operation
from cdff_dev.genom3.idl import identifier, idl_text
from cdff_dev.taste.export import type_names

_SCALARS = {"float": "double", "int": "long long", "string": "string<256>", "bool": "boolean"}
_BITSTREAM = "asn1::bitstream"


def genom3_files(description: DfpcDescription) -> dict[str, str]:
    """Return the files of a DFPC by name: the component, and the types of its messages."""
    name = description.folder
    return {f"{name}.gen": gen_text(description), f"{name}.idl": idl_text(type_names(description), name)}


def gen_text(description: DfpcDescription) -> str:
    """Return the ``.gen`` file of a DFPC."""
    return "\n".join(_lines(description)) + "\n"


def _lines(description: DfpcDescription) -> Iterator[str]:
    name = description.folder
    yield f"/* GENERATED from {name}/dfpc.yaml by cdff generate genom3; do not edit. */"
    yield '#pragma require "infuse-idl >= 0.1"'
    yield '#include "infuse/asn1/bitstream.gen"'
    yield f'#include "{name}.idl"'
    yield ""
    yield f"component {name} {{"
    yield f'  version "{description.version}";'
    yield f"  doc {_quoted(description.doc)};"
    yield '  lang "c++";'
    yield '  codels-require "infuse_asn1_types >= 0.1";'
    yield ""
    yield "  exception bad_type, not_active, failed;"
    yield ""
    for port in description.input_ports:
        yield f"  port in {_BITSTREAM} {identifier(port.attribute)};  /* {port.type_name} */"
    inputs = {port.attribute for port in description.input_ports}
    for output in description.output_ports:
        port_name = f"{output.attribute}_out" if output.attribute in inputs else output.attribute
        yield f"  port out {_BITSTREAM} {identifier(port_name)};  /* {output.type_name} */"
    yield ""
    yield "  ids {"
    yield "    boolean active;"
    yield "  };"
    yield ""
    yield "  task fusion {"
    yield "    period 10 ms;"
    yield "  };"
    for operation in description.operations:
        yield ""
        yield from _activity(operation)
    yield "};"


def _activity(operation: Operation) -> Iterator[str]:
    parameters = []
    for parameter in operation.inputs:
        default = "" if parameter.default is None else f" = {_default(parameter.type, parameter.default)}"
        doc = f": {_quoted(parameter.doc)}" if parameter.doc else ""
        parameters.append(f"in {_SCALARS[parameter.type]} {identifier(parameter.name)}{default}{doc}")
    results = []
    if operation.output_type != "void":
        result = _SCALARS.get(operation.output_type, _BITSTREAM)
        parameters.append(f"out {result} result")
        results = ["out result"]
    name = identifier(operation.name)
    yield f"  activity {name}({', '.join(parameters)}) {{"
    yield f"    doc {_quoted(operation.doc)};"
    arguments = ", ".join([f"in {identifier(p.name)}" for p in operation.inputs] + results)
    yield f"    codel <start> {operation.name}_start({arguments}) yield ether;"
    yield "    throw bad_type, not_active, failed;"
    yield "    task fusion;"
    yield "  };"


def _default(kind: str, text: str) -> str:
    return _quoted(text) if kind == "string" else text


def _quoted(text: str) -> str:
    return '"' + " ".join(text.split()).replace("\\", "\\\\").replace('"', '\\"') + '"'
