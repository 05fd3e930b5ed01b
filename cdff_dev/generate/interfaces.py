# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``interface.py`` of each DFN and DFPC, with the base class of the implementations, from its description."""

from __future__ import annotations

from cdff_common.interfaces.array_ports import ARRAY_TYPE
from cdff_common.interfaces.description import DfnDescription, DfpcDescription
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.python_source import OPERATION_TYPES, class_name, formatted, render
from cdff_dev.tree import Tree


def interfaces(tree: Tree) -> list[Artefact]:
    """Return the interface module of every description in the tree."""
    return [dfn_interface(tree, d) for d in tree.dfns()] + [dfpc_interface(tree, d) for d in tree.dfpcs()]


def dfn_interface(tree: Tree, description: DfnDescription) -> Artefact:
    """Return the module of a DFN: dataclasses of inputs and outputs, base class of implementations."""
    ports = [*description.input_ports, *description.output_ports]
    checked_ports = [p for p in description.input_ports if p.values != "any" or ARRAY_TYPE.match(p.type)]
    restricted = {k: [p for p in description.input_ports if p.values == k] for k in ("finite", "positive")}
    path = tree.folder("dfn", description.folder) / "interface.py"
    text = render(
        "dfn_interface.py.j2",
        dfn=description,
        types=sorted({class_name(p.type_name) for p in ports if p.is_message}),
        arrays=any(ARRAY_TYPE.match(p.type) for p in ports),
        shapes={p.attribute: p.type for p in description.input_ports if ARRAY_TYPE.match(p.type)},
        values={kind: [p.attribute for p in group] for kind, group in restricted.items() if group},
        optional=[p.attribute for p in checked_ports if p.optional],
    )
    return Artefact(path, formatted(text, path))


def dfpc_interface(tree: Tree, description: DfpcDescription) -> Artefact:
    """Return the module of a DFPC: a base class with a method for each input port and each operation."""
    path = tree.folder("dfpc", description.folder) / "interface.py"
    returned_types = {o.output_type for o in description.operations} - OPERATION_TYPES.keys()
    text = render(
        "dfpc_interface.py.j2", dfpc=description, types=sorted(class_name(t) for t in returned_types)
    )
    return Artefact(path, formatted(text, path))
