# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is written once for a new DFN or DFPC and belongs to its author from then on: implementation and test.

A skeleton is honest: it passes lint and its own test and refuses to answer until somebody writes it.
"""

from __future__ import annotations

from pathlib import Path

from cdff_common.interfaces.description import DfnDescription, DfpcDescription, snake_case
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.python_source import formatted, render
from cdff_dev.generate.tree import Tree


def skeletons(tree: Tree) -> list[Artefact]:
    """Skeletons of every description in the tree whose implementation is not there yet."""
    made: list[Artefact] = []
    for dfn in tree.dfns():
        made += dfn_skeleton(tree, dfn)
    for dfpc in tree.dfpcs():
        made += dfpc_skeleton(tree, dfpc)
    return made


def dfn_skeleton(tree: Tree, description: DfnDescription) -> list[Artefact]:
    """Package marker, one module per implementation that is missing, and its test."""
    folder = tree.folder("dfn", description.folder)
    made = [_package(folder / "__init__.py", description.name, "DFN")]
    for implementation in description.implementations:
        module = snake_case(implementation)
        path = folder / f"{module}.py"
        if path.exists():
            continue
        values = {"dfn": description, "implementation": implementation, "module": module}
        test = tree.test_folder("dfn", description.folder) / f"test_{module}.py"
        made.append(Artefact(path, formatted(render("dfn_implementation.py.j2", **values), path), once=True))
        made.append(Artefact(test, formatted(render("dfn_test.py.j2", **values), test), once=True))
    return made


def dfpc_skeleton(tree: Tree, description: DfpcDescription) -> list[Artefact]:
    """Package marker, ``compound.py`` where it is missing, and its test."""
    folder = tree.folder("dfpc", description.folder)
    made = [_package(folder / "__init__.py", description.name, "DFPC")]
    path = folder / "compound.py"
    if not path.exists():
        test = tree.test_folder("dfpc", description.folder) / "test_compound.py"
        made.append(Artefact(path, formatted(render("dfpc_compound.py.j2", dfpc=description), path), once=True))
        made.append(Artefact(test, formatted(render("dfpc_test.py.j2", dfpc=description), test), once=True))
    return made


def _package(path: Path, name: str, kind: str) -> Artefact:
    return Artefact(path, render("package.py.j2", name=name, kind=kind), once=True)
