# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Groups of artefacts of ``cdff generate``."""

from __future__ import annotations

from collections.abc import Iterable
from pkgutil import resolve_name

from cdff_common.errors import ConfigurationError
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.tree import Tree

#: Function that returns the artefacts of each group, imported on use; groups in order of dependency.
GROUPS = {
    "types": "types:modules",
    "interfaces": "interfaces:interfaces",
    "skeletons": "skeletons:skeletons",
    "profile": "profile_schema:schemas",
    "reference": "reference:pages",
    "traceability": "traceability:pages",
}


def chosen_groups(groups: Iterable[str]) -> list[str]:
    """Return the named groups in order, by default all; raises ConfigurationError if one is unknown."""
    names = list(groups) or list(GROUPS)
    unknown = [g for g in names if g not in GROUPS]
    if unknown:
        raise ConfigurationError(f"no group {unknown[0]!r} to generate; known are {', '.join(GROUPS)}")
    return [group for group in GROUPS if group in names]


def plan(tree: Tree, groups: Iterable[str] = ()) -> list[Artefact]:
    """Return the artefacts of the named groups, by default all.

    Raises ConfigurationError if one is unknown.
    """
    artefacts: list[Artefact] = []
    for group in chosen_groups(groups):
        artefacts += resolve_name(f"{__package__}.{GROUPS[group]}")(tree)
    return artefacts
