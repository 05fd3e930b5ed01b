# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Artefacts of ``cdff generate``, by group."""

from __future__ import annotations

from collections.abc import Iterable
from pkgutil import resolve_name

from cdff_common.errors import ConfigurationError
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.tree import Tree

#: Group -> the function that returns its artefacts, in the order of their dependencies; imported on use.
GROUPS = {
    "types": "types:modules",
    "interfaces": "interfaces:interfaces",
    "skeletons": "skeletons:skeletons",
    "profile": "profile_schema:schemas",
    "reference": "reference:pages",
    "traceability": "traceability:pages",
}


def chosen_groups(groups: Iterable[str]) -> list[str]:
    """Return the named groups in order, all if none is named; raises ConfigurationError on an unknown one."""
    chosen = list(groups) or list(GROUPS)
    unknown = [g for g in chosen if g not in GROUPS]
    if unknown:
        raise ConfigurationError(f"no group {unknown[0]!r} to generate; known are {', '.join(GROUPS)}")
    return [group for group in GROUPS if group in chosen]


def plan(tree: Tree, groups: Iterable[str] = ()) -> list[Artefact]:
    """Return all artefacts of the named groups; raises ConfigurationError on an unknown group."""
    made: list[Artefact] = []
    for group in chosen_groups(groups):
        made += resolve_name(f"{__package__}.{GROUPS[group]}")(tree)
    return made
