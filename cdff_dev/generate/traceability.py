# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``docs/reference/traceability.md``: requirements and the tests that verify them."""

from __future__ import annotations

from cdff_dev.check.requirements import Requirement, named_by_tests, read_requirements
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.python_source import render
from cdff_dev.tree import Tree

_GROUPS = {"CORE": "CDFF-Core", "SUP": "CDFF-Support", "DEV": "CDFF-Dev"}
_METHODS = {"T": "test", "A": "analysis", "I": "inspection", "R": "review"}


def pages(tree: Tree) -> list[Artefact]:
    """Return the page; no page if the tree has no requirements."""
    requirements = read_requirements(tree.root)
    if not requirements:
        return []
    tests = named_by_tests(tree.root)
    groups = {title: [r for r in requirements if r.id.split("-")[1] == key] for key, title in _GROUPS.items()}
    text = render(
        "traceability.md.j2",
        groups=groups,
        tests=tests,
        methods=_METHODS,
        state=lambda r: _state(r, tests),
        total=len(requirements),
        built=sum(r.status == "built" for r in requirements),
        named=sum(r.id in tests for r in requirements),
    )
    return [Artefact(tree.root / "docs" / "reference" / "traceability.md", text)]


def _state(requirement: Requirement, tests: dict[str, list[str]]) -> str:
    if requirement.id in tests:
        return "named by tests"
    return "planned, not verified" if requirement.status == "planned" else "**built, not verified**"
