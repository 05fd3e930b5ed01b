# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.description import DfnDescription
from cdff_common.interfaces.registry import Registry
from cdff_dev.check import descriptions, requirements
from cdff_dev.check.requirements import named_by_tests, read_requirements
from cdff_dev.generate.traceability import pages
from cdff_dev.tree import Tree

ROOT = Path(__file__).resolve().parents[4]
BUILT = "{id: CDFF-CORE-010, text: It shall work., source: P, verification: T, status: built}"
PLANNED = "{id: CDFF-DEV-020, text: It shall fly., source: P, verification: T, status: planned}"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "docs" / "requirements").mkdir(parents=True)
    (tmp_path / "tests" / "unit").mkdir(parents=True)
    (tmp_path / "docs" / "requirements" / "core.yaml").write_text(
        f"requirements:\n  - {BUILT}\n  - {PLANNED}\n"
    )
    return tmp_path


def _test(tree: Path, text: str) -> None:
    (tree / "tests" / "unit" / "test_x.py").write_text(f"import pytest\n{text}\n")


def _outcome(tree: Path, outcome: str) -> None:
    (tree / "build").mkdir()
    entry = {"tests/unit/test_x.py::test_a": {"requirements": ["CDFF-CORE-010"], "outcome": outcome}}
    (tree / "build" / "traceability.json").write_text(json.dumps(entry))


def test_a_built_requirement_without_a_test_is_a_fault_and_a_planned_one_is_not(tree: Path) -> None:
    assert requirements.faults(tree) == ["CDFF-CORE-010: built, to be verified by test, but no test names it"]


def test_markers_of_functions_and_of_modules_name_requirements(tree: Path) -> None:
    _test(tree, '@pytest.mark.req("CDFF-CORE-010", "CDFF-DEV-020")\ndef test_a(): pass\ndef test_b(): pass')
    assert named_by_tests(tree) == {
        "CDFF-CORE-010": ["tests/unit/test_x.py::test_a"],
        "CDFF-DEV-020": ["tests/unit/test_x.py::test_a"],
    }
    _test(tree, 'pytestmark = [pytest.mark.slow, pytest.mark.req("CDFF-CORE-010")]\ndef test_a(): pass')
    assert requirements.faults(tree) == []


def test_an_unknown_requirement_id_is_a_fault(tree: Path) -> None:
    _test(tree, '@pytest.mark.req("CDFF-CORE-010", "CDFF-CORE-999")\ndef test_a(): pass')
    assert requirements.faults(tree) == [
        "tests/unit/test_x.py::test_a: names the requirement CDFF-CORE-999, which "
        "docs/requirements does not hold"
    ]


@pytest.mark.parametrize(("outcome", "count"), [("passed", 0), ("failed", 1), ("skipped", 1)])
def test_verified_requires_a_passed_test(tree: Path, outcome: str, count: int) -> None:
    _test(tree, '@pytest.mark.req("CDFF-CORE-010")\ndef test_a(): pass')
    _outcome(tree, outcome)
    assert len(requirements.faults(tree, verified=True)) == count


def test_verified_without_a_test_run_is_reported(tree: Path) -> None:
    with pytest.raises(ConfigurationError, match="run the tests first"):
        requirements.faults(tree, verified=True)


def test_a_repeated_requirement_id_is_refused(tree: Path) -> None:
    (tree / "docs" / "requirements" / "dev.yaml").write_text(f"requirements: [{BUILT}]\n")
    with pytest.raises(ConfigurationError, match="given twice"):
        read_requirements(tree)


def test_a_requirement_without_shall_is_refused(tree: Path) -> None:
    (tree / "docs" / "requirements" / "core.yaml").write_text(
        f"requirements: [{BUILT.replace('shall', 'should')}]\n"
    )
    with pytest.raises(ConfigurationError, match="text="):
        read_requirements(tree)


def test_the_page_marks_unverified_requirements(tree: Path) -> None:
    (page,) = pages(Tree(tree))
    assert "| **built, not verified** |" in page.text
    assert "| planned, not verified |" in page.text


def _laser_filter(**changes: object) -> list[str]:
    registry = Registry.default()
    shipped = registry.dfn("laser_filter")
    changed = DfnDescription.model_validate(shipped.model_dump(exclude_unset=True) | changes)
    return descriptions.dfn_faults(ROOT, changed, registry)


def test_shipped_descriptions_have_no_fault() -> None:
    assert _laser_filter() == []


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"cost": {}}, "template field 'cost' is empty"),
        (
            {
                "cost": {
                    "BoxFilter": {"input": "a", "cpu_s": 0, "memory_mb": 0, "benchmark": "benchmarks/none.py"}
                }
            },
            "benchmark 'benchmarks/none.py' does not exist",
        ),
        ({"tests": ["tests/unit/no_such.py"]}, "test 'tests/unit/no_such.py' does not exist"),
        (
            {"implementations": ["NoiseFilter", "BoxFilter", "Magic"]},
            "implementation Magic: ConfigurationError",
        ),
        ({"input_ports": [{"name": "a", "type": "Nonsense", "doc": "d"}]}, "port a: no type 'Nonsense'"),
        ({"input_ports": [{"name": "a", "type": "LaserScan"}]}, "port a: no doc"),
    ],
)
def test_a_description_that_contradicts_the_code_is_a_fault(changes: dict[str, object], fault: str) -> None:
    assert any(fault in line for line in _laser_filter(**changes))
