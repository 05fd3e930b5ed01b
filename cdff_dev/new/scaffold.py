# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of a new DFN or DFPC: description, interface, skeleton and test, which passes."""

from __future__ import annotations

import re
from pathlib import Path

from cdff_common.errors import ConflictError, InputError
from cdff_common.interfaces.description import read_dfn_description, read_dfpc_description, snake_case
from cdff_dev.generate import interfaces, skeletons
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.python_source import render
from cdff_dev.tree import Tree

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}\Z")


def scaffold(tree: Tree, kind: str, name: str) -> list[Path]:
    """Write the files of a new DFN or DFPC and return their paths, the description first.

    Parameters
    ----------
    tree : Tree
    kind : str
        ``dfn`` or ``dfpc``.
    name : str
        Name of the class (``LaserFilter``) or of the folder (``laser_filter``).

    Raises
    ------
    InputError
        If the name is not an identifier.
    ConflictError
        If a DFN or DFPC of this name exists: names are unique over both.
    """
    if not _NAME.match(name):
        raise InputError(f"name {name!r}: expected an identifier such as LaserFilter or laser_filter")
    title = name if name[0].isupper() else "".join(part.capitalize() for part in name.split("_"))
    folder = snake_case(title)
    for other in ("dfn", "dfpc"):
        if tree.folder(other, folder).exists():
            raise ConflictError(
                f"{tree.folder(other, folder)} exists; choose another name or remove it first"
            )
    path = tree.folder(kind, folder) / f"{kind}.yaml"
    description = Artefact(path, render(f"new_{kind}.yaml.j2", name=title, folder=folder), once=True)
    description.write()
    artefacts = [description]
    if kind == "dfn":
        dfn = read_dfn_description(path)
        artefacts += [interfaces.dfn_interface(tree, dfn), *skeletons.dfn_skeleton(tree, dfn)]
    else:
        dfpc = read_dfpc_description(path)
        artefacts += [interfaces.dfpc_interface(tree, dfpc), *skeletons.dfpc_skeleton(tree, dfpc)]
    for artefact in artefacts[1:]:
        artefact.write()
    return [artefact.path for artefact in artefacts]
