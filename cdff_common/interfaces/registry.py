# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Discovery of DFNs and DFPCs: a folder with a description is one; what fails to load is kept with its reason.

In the tree by ``cdff_core/dfns/*/dfn.yaml`` and ``cdff_core/dfpcs/*/dfpc.yaml``, out of it by packages named in the
entry points ``cdff.dfns`` and ``cdff.dfpcs``.
"""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.errors import CdffError, ConfigurationError
from cdff_common.interfaces.description import (
    DfnDescription,
    DfpcDescription,
    read_dfn_description,
    read_dfpc_description,
    snake_case,
)

if TYPE_CHECKING:
    from cdff_common.interfaces.dfn import Dfn
    from cdff_common.interfaces.dfpc import Dfpc


@dataclass(frozen=True, slots=True)
class Found:
    """A description and the Python package it lies in."""

    package: str
    path: Path
    description: Any


@dataclass(slots=True)
class Registry:
    """All DFNs and DFPCs that were found, by folder name; ``failures`` maps a folder to why it did not load."""

    dfns: dict[str, Found] = field(default_factory=dict)
    dfpcs: dict[str, Found] = field(default_factory=dict)
    aliases: dict[str, str] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    @classmethod
    def default(cls) -> Registry:
        """The registry of this installation, read once."""
        return _default_registry()

    def scan(self, package: str, kind: str) -> None:
        """Add every folder of ``package`` that holds a ``{kind}.yaml``; ``kind`` is ``dfn`` or ``dfpc``."""
        spec = importlib.util.find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            raise ConfigurationError(f"package {package!r} named for {kind}s is not installed")
        for path in sorted(Path(spec.submodule_search_locations[0]).glob(f"*/{kind}.yaml")):
            self._add(package, path, kind)

    def dfn(self, name: str) -> DfnDescription:
        """Description of a DFN by folder name, class name or alias; raises ConfigurationError with what is known."""
        found: DfnDescription = self._find(self.dfns, name, "DFN").description
        return found

    def dfpc(self, name: str) -> DfpcDescription:
        """Description of a DFPC by folder name, class name or alias; raises ConfigurationError with what is known."""
        found: DfpcDescription = self._find(self.dfpcs, name, "DFPC").description
        return found

    def resolve(self, name: str) -> tuple[str, str]:
        """Return ``("dfn"|"dfpc", folder)`` for a name; a DFPC where it is both."""
        folder = self._folder(self.dfpcs, name)
        if folder in self.dfpcs:
            return "dfpc", folder
        return "dfn", self._find(self.dfns, name, "DFN or DFPC").description.folder

    def make_dfn(self, name: str, implementation: str | None = None) -> Dfn[Any, Any, Any]:
        """Make an unconfigured DFN; raises ConfigurationError if it or its implementation is unknown.

        Without ``implementation`` it is the first one, or the one that ``name`` is an alias of.
        """
        found = self._find(self.dfns, name, "DFN")
        description: DfnDescription = found.description
        default = description.implementation_aliases.get(name, description.implementations[0])
        chosen = description.implementation(implementation or default)
        module = importlib.import_module(f"{found.package}.{description.folder}.{snake_case(chosen)}")
        made: Dfn[Any, Any, Any] = getattr(module, chosen)()
        return made

    def make_dfpc(self, name: str) -> Dfpc:
        """Make an unconfigured DFPC; raises ConfigurationError if it is unknown."""
        found = self._find(self.dfpcs, name, "DFPC")
        description: DfpcDescription = found.description
        module = importlib.import_module(f"{found.package}.{description.folder}.compound")
        made: Dfpc = getattr(module, description.name)()
        return made

    def _folder(self, known: dict[str, Found], name: str) -> str:
        # A folder's name stands for itself: snake_case of it may be another (X1 lies in x1, and x1 would be x_1).
        plain = snake_case(name)
        candidates = (name, self.aliases.get(name, ""), self.aliases.get(plain, ""), plain)
        return next((folder for folder in candidates if folder in known or folder in self.failures), plain)

    def _find(self, known: dict[str, Found], name: str, what: str) -> Found:
        folder = self._folder(known, name)
        if folder in known:
            return known[folder]
        if folder in self.failures:
            raise ConfigurationError(f"{what} {name!r} did not load: {self.failures[folder]}")
        raise ConfigurationError(f"no {what} {name!r}; known are {', '.join(sorted(known)) or 'none'}")

    def _add(self, package: str, path: Path, kind: str) -> None:
        folder = path.parent.name
        try:
            description: Any = read_dfn_description(path) if kind == "dfn" else read_dfpc_description(path)
            if description.folder != folder:
                raise ConfigurationError(f"{path}: name {description.name} belongs in folder {description.folder}")
            if folder in self.dfns or folder in self.dfpcs:
                raise ConfigurationError(f"{path}: the name {folder} is taken")
        except CdffError as error:
            self.failures[folder] = str(error)
            return
        (self.dfns if kind == "dfn" else self.dfpcs)[folder] = Found(package, path, description)
        for alias in (*description.aliases, *getattr(description, "implementation_aliases", ())):
            self.aliases[alias] = folder


@cache
def _default_registry() -> Registry:
    registry = Registry()
    for kind in ("dfn", "dfpc"):
        registry.scan(f"cdff_core.{kind}s", kind)
        for entry in entry_points(group=f"cdff.{kind}s"):
            try:
                registry.scan(entry.value, kind)
            except CdffError as error:
                registry.failures[entry.name] = str(error)
    return registry
