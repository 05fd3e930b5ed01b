# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``_interface.py`` of every DFN and DFPC: what an implementation subclasses, made from its description."""

from __future__ import annotations

from cdff_common.interfaces.description import DfnDescription, DfpcDescription
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.python_source import class_name, formatted, is_array, render
from cdff_dev.generate.tree import Tree

_PLAIN_OPERATION_TYPES = frozenset({"void", "float", "int", "string", "bool"})


def interfaces(tree: Tree) -> list[Artefact]:
    """The interface module of every description in the tree."""
    return [dfn_interface(tree, d) for d in tree.dfns()] + [dfpc_interface(tree, d) for d in tree.dfpcs()]


def dfn_interface(tree: Tree, description: DfnDescription) -> Artefact:
    """Dataclasses of the inputs and outputs, and the abstract class."""
    ports = [*description.input_ports, *description.output_ports]
    path = tree.folder("dfn", description.folder) / "_interface.py"
    text = render(
        "dfn_interface.py.j2",
        dfn=description,
        types=sorted({class_name(p.type_name) for p in ports if not is_array(p)}),
        arrays=any(is_array(p) for p in ports),
    )
    return Artefact(path, formatted(text, path))


def dfpc_interface(tree: Tree, description: DfpcDescription) -> Artefact:
    """The abstract class with one ``on_<port>`` per input port and one method per operation."""
    path = tree.folder("dfpc", description.folder) / "_interface.py"
    returned = {o.output_type for o in description.operations} - _PLAIN_OPERATION_TYPES
    text = render("dfpc_interface.py.j2", dfpc=description, types=sorted(class_name(t) for t in returned))
    return Artefact(path, formatted(text, path))
