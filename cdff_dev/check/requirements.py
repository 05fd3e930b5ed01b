# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requirements (``docs/requirements/*.yaml``) and the tests that name them (``@pytest.mark.req("CDFF-…")``).

The requirements that a test names are read from its source, so that the generated page is the same on every
machine. The outcome of the tests is in ``build/traceability.json``, which every test run writes.
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
    """A requirement; ``verification`` is by test (T), analysis (A), inspection (I) or review (R)."""

    id: RequirementId
    text: Annotated[str, Field(pattern=r"\bshall\b")]
    source: str
    verification: Literal["T", "A", "I", "R"]
    status: Literal["built", "planned"]


class _File(StrictModel):
    requirements: tuple[Requirement, ...]


def read_requirements(root: Path) -> list[Requirement]:
    """Return all requirements of the checkout.

    Raises ConfigurationError if a file is invalid, or an id is given twice.
    """
    by_id: dict[str, Requirement] = {}
    for path in sorted((root / "docs" / "requirements").glob("*.yaml")):
        for requirement in validated(
            _File, yaml.safe_load(path.read_text(encoding="utf-8")), str(path)
        ).requirements:
            if requirement.id in by_id:
                raise ConfigurationError(f"{path}: the id {requirement.id} is given twice")
            by_id[requirement.id] = requirement
    return list(by_id.values())


def named_by_tests(root: Path) -> dict[str, list[str]]:
    """Return the tests, such as ``tests/…/test_x.py::test_y``, that name each requirement, by its id."""
    tests_of: dict[str, list[str]] = {}
    for path in sorted((root / "tests").rglob("test_*.py")):
        name = path.relative_to(root).as_posix()
        for test, requirement in _test_requirements(ast.parse(path.read_text(encoding="utf-8"))):
            tests_of.setdefault(requirement, []).append(f"{name}::{test}")
    return {requirement: sorted(set(tests)) for requirement, tests in tests_of.items()}


def faults(root: Path, *, verified: bool = False) -> list[str]:
    """Return the inconsistencies between requirements and tests.

    Parameters
    ----------
    root : Path
        The checkout.
    verified : bool
        If True, a built requirement of which no test passed in the last test run is a fault.
    """
    requirements = {r.id: r for r in read_requirements(root)}
    tests = named_by_tests(root)
    found_faults = [
        f"{tests[i][0]}: names the requirement {i}, which docs/requirements does not hold"
        for i in sorted(set(tests) - set(requirements))
    ]
    to_be_tested = [r for r in requirements.values() if r.status == "built" and r.verification == "T"]
    found_faults += [
        f"{r.id}: built, to be verified by test, but no test names it"
        for r in to_be_tested
        if r.id not in tests
    ]
    if verified:
        passed = _passed_tests(root)
        found_faults += [
            f"{r.id}: no test of it passed in the last run (build/traceability.json)"
            for r in to_be_tested
            if r.id in tests and r.id not in passed
        ]
    return found_faults


def _passed_tests(root: Path) -> set[str]:
    path = root / "build" / "traceability.json"
    try:
        outcomes = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path}: {error}; run the tests first") from error
    return {i for entry in outcomes.values() if entry["outcome"] == "passed" for i in entry["requirements"]}


def _test_requirements(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield ``(test, requirement)`` of a module, from decorators of its functions and from ``pytestmark``."""
    of_module = [i for node in tree.body if _is_pytestmark(node) for i in _ids(node)]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            for i in of_module + [i for d in node.decorator_list for i in _ids(d)]:
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
