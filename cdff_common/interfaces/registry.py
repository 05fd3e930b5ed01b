# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Discovery of DFNs and DFPCs: every folder with a description; failures are stored with their reason.

In this repository they are found by ``cdff_core/dfns/*/dfn.yaml`` and ``cdff_core/dfpcs/*/dfpc.yaml``,
outside by the packages of the entry points ``cdff.dfns`` and ``cdff.dfpcs``.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Collection
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
class DiscoveredPackage:
    """Description of a DFN or DFPC and its Python package."""

    package: str
    path: Path
    description: Any

    def load(self, module: str, name: str) -> Any:
        """Return a class of a module of the folder; raises ConfigurationError with file and reason."""
        try:
            return getattr(importlib.import_module(f"{self.package}.{self.path.parent.name}.{module}"), name)
        except Exception as error:
            raise ConfigurationError(f"{self.path.parent / module}.py: {_reason(error)}") from error


@dataclass(slots=True)
class Registry:
    """Discovered DFNs and DFPCs by folder name; ``failures`` maps a folder to the reason of its failure."""

    dfns: dict[str, DiscoveredPackage] = field(default_factory=dict)
    dfpcs: dict[str, DiscoveredPackage] = field(default_factory=dict)
    aliases: dict[str, str] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    @classmethod
    def default(cls) -> Registry:
        """Return the registry of this installation, read once."""
        return _default_registry()

    def scan(self, package: str, kind: str) -> None:
        """Add every folder of ``package`` with a ``{kind}.yaml``; ``kind`` is ``dfn`` or ``dfpc``."""
        try:
            spec = importlib.util.find_spec(package)
        except Exception as error:
            raise ConfigurationError(
                f"cannot import package {package!r}, searched for {kind.upper()}s: {_reason(error)}"
            ) from error
        if spec is None or not spec.submodule_search_locations:
            raise ConfigurationError(f"package {package!r}, searched for {kind.upper()}s, is not installed")
        for path in sorted(Path(spec.submodule_search_locations[0]).glob(f"*/{kind}.yaml")):
            self._add(package, path, kind)

    def dfn(self, name: str) -> DfnDescription:
        """Return the description of a DFN by folder name, class name or alias; raises ConfigurationError."""
        description: DfnDescription = self._find(self.dfns, name, "DFN").description
        return description

    def dfpc(self, name: str) -> DfpcDescription:
        """Return the description of a DFPC by folder name, class name or alias; raises ConfigurationError."""
        description: DfpcDescription = self._find(self.dfpcs, name, "DFPC").description
        return description

    def resolve(self, name: str) -> tuple[str, str]:
        """Return ``("dfn"|"dfpc", folder)`` for a name; a DFPC has priority."""
        folder = self._folder(self.dfpcs, name)
        if folder in self.dfpcs:
            return "dfpc", folder
        return "dfn", self._find(self.dfns, name, "DFN or DFPC", self.dfpcs).description.folder

    def make_dfn(self, name: str, implementation: str | None = None) -> Dfn[Any, Any, Any]:
        """Create an unconfigured DFN; raises ConfigurationError if it or its implementation is unknown.

        Without ``implementation`` it is the one with the alias ``name``, else the first.
        """
        package_entry = self._find(self.dfns, name, "DFN")
        description: DfnDescription = package_entry.description
        default = description.implementation_aliases.get(name, description.implementations[0])
        implementation_name = description.implementation(implementation or default)
        instance: Dfn[Any, Any, Any] = package_entry.load(
            snake_case(implementation_name), implementation_name
        )()
        return instance

    def make_dfpc(self, name: str) -> Dfpc:
        """Create an unconfigured DFPC; raises ConfigurationError if it is unknown."""
        package_entry = self._find(self.dfpcs, name, "DFPC")
        instance: Dfpc = package_entry.load("compound", package_entry.description.name)()
        return instance

    def load_plugins(self) -> None:
        """Import every implementation outside ``cdff_core``; one that fails moves to ``failures``."""
        for packages in (self.dfns, self.dfpcs):
            for folder, package_entry in list(packages.items()):
                if package_entry.package.startswith("cdff_core."):
                    continue
                names = package_entry.description.implementations
                try:
                    for name in names if packages is self.dfns else ():
                        package_entry.load(snake_case(name), name)
                    if packages is self.dfpcs:
                        package_entry.load("compound", package_entry.description.name)
                except ConfigurationError as error:
                    self.failures[folder] = str(error)
                    del packages[folder]

    def _folder(self, packages: dict[str, DiscoveredPackage], name: str) -> str:
        # A folder name has priority, since its snake case may differ (X1 is in x1, and x1 would become x_1).
        folder_name = snake_case(name)
        candidates = (name, self.aliases.get(name, ""), self.aliases.get(folder_name, ""), folder_name)
        return next(
            (folder for folder in candidates if folder in packages or folder in self.failures), folder_name
        )

    def _find(
        self, packages: dict[str, DiscoveredPackage], name: str, kind: str, others: Collection[str] = ()
    ) -> DiscoveredPackage:
        """Return a package by a name or alias; raises ConfigurationError, which also names ``others``."""
        folder = self._folder(packages, name)
        if folder in packages:
            return packages[folder]
        if folder in self.failures:
            raise ConfigurationError(f"{kind} {name!r} did not load: {self.failures[folder]}")
        from cdff_common.command_parser import suggestion

        known = sorted({*packages, *others})
        raise ConfigurationError(
            f"no {kind} {name!r}; expected one of {', '.join(known) or 'none'}{suggestion(name, known)}"
        )

    def _add(self, package: str, path: Path, kind: str) -> None:
        """Add the description of a folder; a faulty one is listed in ``failures``."""
        folder = path.parent.name
        try:
            description: Any = read_dfn_description(path) if kind == "dfn" else read_dfpc_description(path)
            if description.folder != folder:
                raise ConfigurationError(
                    f"{path}: name {description.name} belongs in folder {description.folder}"
                )
            if folder in self.dfns or folder in self.dfpcs:
                raise ConfigurationError(f"{path}: the name {folder} is taken")
        except CdffError as error:
            self.failures[folder] = str(error)
            return
        (self.dfns if kind == "dfn" else self.dfpcs)[folder] = DiscoveredPackage(package, path, description)
        for alias in (*description.aliases, *getattr(description, "implementation_aliases", ())):
            self.aliases[alias] = folder


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


@cache
def _default_registry() -> Registry:
    """Return the registry of the installed DFNs and DFPCs; plug-ins that fail are listed in ``failures``."""
    registry = Registry()
    for kind in ("dfn", "dfpc"):
        registry.scan(f"cdff_core.{kind}s", kind)
        for entry in entry_points(group=f"cdff.{kind}s"):
            try:
                registry.scan(entry.value, kind)
            except CdffError as error:
                registry.failures[entry.name] = str(error)
    return registry
