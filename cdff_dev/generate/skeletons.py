# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Skeletons of the implementation and the test of a new DFN or DFPC, which are written once.

A skeleton passes lint and its test. It refuses every input until the implementation is written.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

from cdff_common.interfaces.description import DfnDescription, DfpcDescription, snake_case
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.python_source import formatted, render
from cdff_dev.tree import Tree


def skeletons(tree: Tree) -> list[Artefact]:
    """Return the skeletons of all implementations in descriptions that do not exist."""
    artefacts: list[Artefact] = []
    for dfn in tree.dfns():
        artefacts += dfn_skeleton(tree, dfn)
    for dfpc in tree.dfpcs():
        artefacts += dfpc_skeleton(tree, dfpc)
    return artefacts


def stale_skeletons(tree: Tree) -> list[Path]:
    """Return modules, tests and folders of implementations that are in no description."""
    return sorted({*_stale(tree, "dfn"), *_stale(tree, "dfpc")})


def _stale(tree: Tree, kind: str) -> Iterator[Path]:
    """Yield the folders and modules without a description: of removed or renamed DFNs and DFPCs."""
    described = {d.folder: d for d in (tree.dfns() if kind == "dfn" else tree.dfpcs())}
    for interface in (tree.root / "cdff_core" / f"{kind}s").glob("*/interface.py"):
        folder = interface.parent
        if folder.name not in described:
            yield folder
            continue
        description = described[folder.name]
        described_classes = description.implementations if kind == "dfn" else (description.name,)
        for path in folder.glob("[a-z]*.py"):
            classes = _implementations(path) if path != interface else []
            # A module may also contain base classes; a skeleton has the name of its class.
            if kind == "dfn":
                classes = [name for name in classes if snake_case(name) == path.stem]
            if classes and not set(classes) & set(described_classes):
                yield path
                test = tree.test_folder(kind, folder.name) / f"test_{path.name}"
                yield from [test] if test.is_file() else []


def _implementations(path: Path) -> list[str]:
    """Return the names of the classes of a module that subclass an interface."""
    return [
        node.name
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
        and any(ast.unparse(base).partition("[")[0].endswith("Interface") for base in node.bases)
    ]


def dfn_skeleton(tree: Tree, description: DfnDescription) -> list[Artefact]:
    """Return ``__init__.py`` and, for each missing implementation, its module and test."""
    modules = {
        (module := snake_case(implementation)): {"implementation": implementation, "module": module}
        for implementation in description.implementations
    }
    return _skeleton(tree, "dfn", description, modules, "dfn_implementation.py.j2")


def dfpc_skeleton(tree: Tree, description: DfpcDescription) -> list[Artefact]:
    """Return ``__init__.py`` and, if it is missing, ``compound.py`` with its test."""
    return _skeleton(tree, "dfpc", description, {"compound": {}}, "dfpc_compound.py.j2")


def _skeleton(
    tree: Tree,
    kind: str,
    description: DfnDescription | DfpcDescription,
    modules: Mapping[str, Mapping[str, str]],
    template: str,
) -> list[Artefact]:
    """Return ``__init__.py`` and each missing module with its test.

    ``modules`` maps the name of a module to the values for its template.
    """
    folder, tests = tree.folder(kind, description.folder), tree.test_folder(kind, description.folder)
    init_text = render("package.py.j2", name=description.name, kind=kind.upper())
    artefacts = [Artefact(folder / "__init__.py", init_text, once=True)]
    for module, names in modules.items():
        path = folder / f"{module}.py"
        if path.exists():
            continue
        for target, source in ((path, template), (tests / f"test_{module}.py", f"{kind}_test.py.j2")):
            text = render(source, **{kind: description}, **names)
            artefacts.append(Artefact(target, formatted(text, target), once=True))
    return artefacts
