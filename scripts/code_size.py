# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Size of the hand-written Python of the product at commits: ``python scripts/code_size.py FIRST LAST ...``.

The unit is the node of the syntax tree, so that formatting, comments and docstrings do not count. Generated
files do not count, nor does the former ``cdff_dev/evaluate``, which is now ``evaluation/``. Files that match
a prefix of ``code_size_new.txt`` belong to capabilities that the first commit does not have.
"""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("cdff_common", "cdff_core", "cdff_dev", "dpm_store", "services")
NEW = tuple(Path(__file__).with_name("code_size_new.txt").read_text().split())
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def trees(commit: str) -> Iterator[tuple[str, ast.Module]]:
    """Yield path and syntax tree, without docstrings, of each hand-written file."""
    archive = subprocess.run(("git", "archive", commit, *PACKAGES), capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for member in files:
            path, file = member.name, files.extractfile(member)
            if file is None or not path.endswith(".py") or path.startswith("cdff_dev/evaluate/"):
                continue
            source = file.read()
            if b"GENERATED from" in source[:400]:
                continue
            tree = ast.parse(source)
            for node in ast.walk(tree):
                if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
                    del node.body[0]
            yield path, tree


def size(node: ast.AST) -> int:
    """Return the number of nodes of a tree."""
    return sum(1 for _ in ast.walk(node))


def functions(node: ast.AST, prefix: str = "") -> Iterator[tuple[str, int]]:
    """Yield qualified name and size of each function and method, without nested functions."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            yield from functions(child, f"{prefix}{child.name}.")
        elif isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield prefix + child.name, size(child)


def is_new(path: str, folders: set[str]) -> bool:
    """Return whether a file is of a new capability: by its prefix, or of a new DFN or DFPC."""
    is_component = path.startswith(("cdff_core/dfns/", "cdff_core/dfpcs/")) and path.count("/") > 2
    return path.startswith(NEW) or (is_component and path.rsplit("/", 1)[0] not in folders)


def main(commits: list[str]) -> None:
    """Print the sizes at each commit, and those of the functions that it shares with the first one."""
    first = dict(trees(commits[0]))
    folders = {path.rsplit("/", 1)[0] for path in first}
    first_functions = unique_functions(first)
    for commit in commits:
        found = first if commit == commits[0] else dict(trees(commit))
        sizes = {path: size(tree) for path, tree in found.items()}
        new = {path for path in found if commit != commits[0] and is_new(path, folders)}
        print(f"{commit}: {len(found)} files")
        for package in (*PACKAGES, ""):
            total = Counter[bool]()
            for path, count in sizes.items():
                if path.startswith(package):
                    total[path in new] += count
            print(f"  {package or 'all':12} {total[False]:9} nodes, new capabilities {total[True]:9}")
        shared = unique_functions(found)
        names = first_functions.keys() & shared.keys()
        before, after = (sum(sizes[name] for name in names) for sizes in (first_functions, shared))
        print(f"  {len(names)} functions of the first commit: {before} nodes there, {after} here")


def unique_functions(found: dict[str, ast.Module]) -> dict[str, int]:
    """Return the sizes of the functions whose qualified names occur once."""
    pairs = [pair for tree in found.values() for pair in functions(tree)]
    counts = Counter(name for name, _ in pairs)
    return {name: count for name, count in pairs if counts[name] == 1}


if __name__ == "__main__":
    main(sys.argv[1:])
