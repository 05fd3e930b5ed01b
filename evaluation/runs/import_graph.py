# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Graph of the files of a tree: which files a file can execute, by its imports and by names of plug-ins."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath

#: Steps for a plug-in that a file uses by the name of its folder: loading it is one more than an import.
_PLUGIN_STEPS = 2
_IMPORT = re.compile(r"^\s*(?:import ([\w.]+)|from ([\w.]+) import (\([^)]*\)|.*))", re.MULTILINE)
_IMPLEMENTATION = re.compile(r"name: (\w+), implementation: (\w+)")


class ImportGraph:
    """Files and the files that they use.

    Parameters
    ----------
    files : mapping of str to str
        Text of each Python file, and of each ``dfpc.yaml``, by its path relative to the root.
    """

    def __init__(self, files: Mapping[str, str]) -> None:
        self._users: dict[str, dict[str, int]] = {}
        plugins = _plugins(files)
        classes = {
            (PurePosixPath(file).parent.name, name): file
            for file, text in files.items()
            if file.startswith("cdff_core/dfns/")
            for name in re.findall(r"^class (\w+)", text, re.MULTILINE)
        }
        for file, text in files.items():
            if file.endswith(".yaml"):
                compound = str(PurePosixPath(file).with_name("compound.py"))
                for dfn, implementation in _IMPLEMENTATION.findall(text):
                    if used_file := classes.get((_snake_case(dfn), implementation)):
                        self._add(compound, used_file, _PLUGIN_STEPS)
                continue
            for used_file in _imported(text, files):
                self._add(file, used_file, 1)
            for name in plugins.keys() & set(re.findall(r"\w+", text)) if file.startswith("tests/") else ():
                for used_file in plugins[name]:
                    self._add(file, used_file, _PLUGIN_STEPS)

    def _add(self, user: str, used_file: str, steps: int) -> None:
        users = self._users.setdefault(used_file, {})
        users[user] = min(steps, users.get(user, steps))

    def steps_to(self, path: str) -> dict[str, int]:
        """Return the number of steps from each file that can execute ``path``."""
        steps, waiting = {path: 0}, [[path]]
        for level, files in enumerate(waiting):
            for file in files:
                if steps[file] < level:
                    continue
                for user, distance in self._users.get(file, {}).items():
                    if level + distance < steps.get(user, level + distance + 1):
                        steps[user] = level + distance
                        while len(waiting) <= level + distance:
                            waiting.append([])
                        waiting[level + distance].append(user)
        return steps


def _plugins(files: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the files of each DFN and DFPC that a registry loads by the name of its folder."""
    plugins: dict[str, list[str]] = {}
    for file in files:
        path = PurePosixPath(file)
        is_plugin = path.parts[:2] == ("cdff_core", "dfns") and not path.name.startswith("_")
        if path.parts[:2] == ("cdff_core", "dfpcs"):
            is_plugin = path.name == "compound.py"
        if is_plugin and path.suffix == ".py":
            plugins.setdefault(path.parent.name, []).append(file)
    return plugins


def _imported(text: str, files: Mapping[str, str]) -> Iterator[str]:
    for imported, module, names in _IMPORT.findall(text):
        modules = [imported] if imported else [module, *(f"{module}.{n}" for n in re.findall(r"\w+", names))]
        for name in modules:
            folder = name.replace(".", "/")
            yield from (file for file in (f"{folder}.py", f"{folder}/__init__.py") if file in files)


def _snake_case(name: str) -> str:
    """Return the name of the folder of a DFN: ``Registration3D`` is in ``registration_3d``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
