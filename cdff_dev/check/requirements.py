# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requirements (``docs/requirements/*.yaml``) and the tests that name them (``@pytest.mark.req("CDFF-…")``).

Which test names which requirement is read from the source, so that the page made of it is the same on every
machine; whether those tests passed is in ``build/traceability.json``, which every test run writes.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import Field

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import StrictModel, validated

RequirementId = Annotated[str, Field(pattern=r"^CDFF-(CORE|SUP|DEV)-\d{3}$")]


class Requirement(StrictModel):
    """One clause: ``verification`` is T test, A analysis, I inspection or R review."""

    id: RequirementId
    text: Annotated[str, Field(pattern=r"\bshall\b")]
    source: str
    verification: Literal["T", "A", "I", "R"]
    status: Literal["built", "planned"]


class _File(StrictModel):
    requirements: tuple[Requirement, ...]


def read_requirements(root: Path) -> list[Requirement]:
    """Return all requirements of the checkout; raises ConfigurationError on a wrong file and on an id given
    twice.
    """
    found: dict[str, Requirement] = {}
    for path in sorted((root / "docs" / "requirements").glob("*.yaml")):
        for requirement in validated(
            _File, yaml.safe_load(path.read_text(encoding="utf-8")), str(path)
        ).requirements:
            if requirement.id in found:
                raise ConfigurationError(f"{path}: the id {requirement.id} is given twice")
            found[requirement.id] = requirement
    return list(found.values())


def named_by_tests(root: Path) -> dict[str, list[str]]:
    """Id -> tests that name it, as ``tests/unit/…/test_x.py::test_y``, sorted."""
    found: dict[str, list[str]] = {}
    for path in sorted((root / "tests").rglob("test_*.py")):
        name = path.relative_to(root).as_posix()
        for test, requirement in _named(ast.parse(path.read_text(encoding="utf-8"))):
            found.setdefault(requirement, []).append(f"{name}::{test}")
    return {requirement: sorted(set(tests)) for requirement, tests in found.items()}


def faults(root: Path, *, verified: bool = False) -> list[str]:
    """Return the inconsistencies between requirements and tests.

    Parameters
    ----------
    root : Path
        The checkout.
    verified : bool
        Also demand that the last test run passed a test of every built requirement.
    """
    requirements = {r.id: r for r in read_requirements(root)}
    tests = named_by_tests(root)
    wrong = [
        f"{tests[i][0]}: names the requirement {i}, which docs/requirements does not hold"
        for i in sorted(set(tests) - set(requirements))
    ]
    due = [r for r in requirements.values() if r.status == "built" and r.verification == "T"]
    wrong += [
        f"{r.id}: built, to be verified by test, but no test names it" for r in due if r.id not in tests
    ]
    if verified:
        passed = _passed(root)
        wrong += [
            f"{r.id}: no test of it passed in the last run (build/traceability.json)"
            for r in due
            if r.id in tests and r.id not in passed
        ]
    return wrong


def _passed(root: Path) -> set[str]:
    path = root / "build" / "traceability.json"
    try:
        outcomes = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path}: {error}; run the tests first") from error
    return {i for entry in outcomes.values() if entry["outcome"] == "passed" for i in entry["requirements"]}


def _named(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """``(test, requirement)`` of one module: from decorators of functions and classes and from
    ``pytestmark``.
    """
    common = [i for node in tree.body if _is_pytestmark(node) for i in _ids(node)]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            for i in common + [i for d in node.decorator_list for i in _ids(d)]:
                yield node.name, i


def _is_pytestmark(node: ast.stmt) -> bool:
    return isinstance(node, ast.Assign) and any(
        isinstance(t, ast.Name) and t.id == "pytestmark" for t in node.targets
    )


def _ids(node: ast.AST) -> Iterator[str]:
    for call in ast.walk(node):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "req":
            yield from (
                a.value for a in call.args if isinstance(a, ast.Constant) and isinstance(a.value, str)
            )
