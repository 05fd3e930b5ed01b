# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Everything ``cdff generate`` makes, by group."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from cdff_common.errors import ConfigurationError
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.tree import Tree

Renderer = Callable[[Tree], list[Artefact]]


def _types(tree: Tree) -> list[Artefact]:
    from cdff_dev.generate import types
    from cdff_dev.generate.python_source import formatted

    return [Artefact(tree.root / path, formatted(text, path)) for path, text in types.render().items()]


def _interfaces(tree: Tree) -> list[Artefact]:
    from cdff_dev.generate import interfaces

    return interfaces.interfaces(tree)


def _skeletons(tree: Tree) -> list[Artefact]:
    from cdff_dev.generate import skeletons

    return skeletons.skeletons(tree)


def _profile(tree: Tree) -> list[Artefact]:
    from cdff_dev.generate import profile_schema

    return profile_schema.schemas(tree)


def _reference(tree: Tree) -> list[Artefact]:
    from cdff_dev.generate import reference

    return reference.pages(tree)


def _traceability(tree: Tree) -> list[Artefact]:
    from cdff_dev.generate import traceability

    return traceability.pages(tree)


#: Group -> what makes it, in the order in which one needs the other.
GROUPS: dict[str, Renderer] = {
    "types": _types,
    "interfaces": _interfaces,
    "skeletons": _skeletons,
    "profile": _profile,
    "reference": _reference,
    "traceability": _traceability,
}


def plan(tree: Tree, groups: Iterable[str] = ()) -> list[Artefact]:
    """All artefacts of the groups named (none means all); raises ConfigurationError on an unknown group."""
    chosen = list(groups) or list(GROUPS)
    unknown = [g for g in chosen if g not in GROUPS]
    if unknown:
        raise ConfigurationError(f"no group {unknown[0]!r} to generate; known are {', '.join(GROUPS)}")
    return [artefact for group in GROUPS if group in chosen for artefact in GROUPS[group](tree)]
