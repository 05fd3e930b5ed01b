# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mutants are single changes of the code, drawn by seed; the record counts those that tests notice."""

from __future__ import annotations

import ast
import itertools
from collections import Counter
from pathlib import Path

import pytest

from cdff_common.errors import InputError
from evaluation import mutation
from evaluation.__main__ import main
from evaluation.runs.mutants import mutants

SOURCE = b'''"""A text."""
LIMIT: float = 0.5


class Ramp:
    def height(self, x: float, steps: int = 3) -> float:
        """Return 2 times x."""
        if x < LIMIT and not self.flat:
            raise ValueError(f"x={x + 1}: expected {LIMIT} or more")
        self.log(x, level=2)
        return -x * (
            steps
            + 100
        )
'''


def changes(source: bytes) -> dict[str, set[tuple[str, str]]]:
    changes_by_operator: dict[str, set[tuple[str, str]]] = {}
    for mutant in mutants("ramp.py", source):
        changes_by_operator.setdefault(mutant.operator, set()).add((mutant.before, mutant.after))
    return changes_by_operator


def test_operators_comparisons_factors_branches_and_arguments_are_changed() -> None:
    assert changes(SOURCE) == {
        "boundary": {("x < LIMIT", "x <= LIMIT")},
        "negated comparison": {("x < LIMIT", "x >= LIMIT")},
        "and/or": {("x < LIMIT and (not self.flat)", "x < LIMIT or not self.flat")},
        "dropped operand": {
            ("x < LIMIT and (not self.flat)", "x < LIMIT"),
            ("x < LIMIT and (not self.flat)", "not self.flat"),
        },
        "dropped branch": {("x < LIMIT and (not self.flat)", value) for value in ("True", "False")},
        "negation": {("not self.flat", "self.flat")},
        "sign": {("-x", "x")},
        "arithmetic": {("-x * (steps + 100)", "-x / (steps + 100)"), ("steps + 100", "steps - 100")},
        "constant": {("0.5", "1.5"), ("3", "4"), ("2", "3"), ("100", "200")},
        "dropped argument": {("self.log(x, level=2)", "self.log(x)")},
        "dropped statement": {("self.log(x, level=2)", "pass")},
    }


def test_a_mutant_is_valid_code_with_the_same_line_numbers() -> None:
    for mutant in mutants("ramp.py", SOURCE):
        changed = mutant.applied(SOURCE)
        assert changed != SOURCE
        assert changed.count(b"\n") == SOURCE.count(b"\n")
        assert ast.unparse(ast.parse(changed)) != ast.unparse(ast.parse(SOURCE))


def test_the_function_of_a_mutant_is_that_of_a_trace() -> None:
    assert {(m.function, m.before) for m in mutants("ramp.py", SOURCE) if m.line <= 6} == {
        ("", "0.5"),
        ("", "3"),
    }
    assert {m.function for m in mutants("ramp.py", SOURCE) if m.line > 6} == {"Ramp.height"}


def test_functions_that_only_compile_and_conditions_of_log_messages_are_not_changed() -> None:
    compiles = 'def setup(self) -> None:\n    """Compile the kernels."""\n    kernel(ones(3), limit=0.5)\n'
    logs = "def f(x):\n    if x > 1:\n        log.info('x')\n"
    assert not mutants("a.py", (compiles + logs).encode())
    clears = compiles.replace("Compile", "Clear the map; compile")
    logs_and_clears = logs + "        x.clear()\n"
    assert {m.function for m in mutants("a.py", (clears + logs_and_clears).encode())} == {"setup", "f"}
    returns = compiles.replace("None", "Kernel")
    assert mutants("a.py", returns.encode())


def test_equal_changes_of_one_function_have_different_keys() -> None:
    all_mutants = mutants("a.py", b"def f(x):\n    return x[0] + x[0]\n")
    assert len({m.key for m in all_mutants}) == len(all_mutants)


def test_a_sample_is_repeated_by_its_seed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(mutation, "PARTS_OF_CODE", {"a": (0.75, ("a",)), "b": (0.25, ("b",))})
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "ramp.py").write_bytes(SOURCE)
        (tmp_path / folder / "commands.py").write_bytes(SOURCE)
    samples = [[m.key for _, m in mutation.sample(tmp_path, seed, 8)] for seed in (1, 1, 2)]
    assert samples[0] == samples[1] != samples[2]
    assert Counter(part for part, _ in mutation.sample(tmp_path, 1, 8)) == {"a": 6, "b": 2}
    assert not any("commands" in key for key in itertools.chain(*samples))


def test_a_sample_of_one_module_is_repeated_by_its_seed_and_has_no_other_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(mutation, "PARTS_OF_CODE", {"a": (0.75, ("a",)), "b": (0.25, ("b",))})
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "ramp.py").write_bytes(SOURCE)
    samples = [
        [m.key for _, m in mutation.sample(tmp_path, s, n, "b/ramp.py")] for s, n in ((1, 8), (1, 4), (2, 8))
    ]
    assert samples[0][:4] == samples[1]
    assert samples[0] != samples[2]
    assert {part for part, _ in mutation.sample(tmp_path, 1, 8, "b/ramp.py")} == {"b"}
    everything = list(mutation.sample(tmp_path, 1, 1000, "b/ramp.py"))
    assert {m.key for _, m in everything} == {m.key for m in mutants("b/ramp.py", SOURCE)}
    with pytest.raises(InputError, match=r"c/ramp\.py"):
        list(mutation.sample(tmp_path, 1, 8, "c/ramp.py"))


def test_mutants_of_one_module_are_not_recorded_as_those_of_the_whole_code() -> None:
    with pytest.raises(InputError, match="--draft"):
        main(["mutation", "--module", "cdff_core/imaging/sampson.py"])


def test_the_ratio_is_that_of_the_mutants_that_are_not_equivalent() -> None:
    counts = Counter({"killed": 8, "timeout": 1, "survived": 1, "equivalent": 5})
    assert mutation.killed_ratio(counts) == 0.9


def test_the_interval_of_the_ratio_narrows_with_the_number_of_mutants() -> None:
    few, many = Counter({"killed": 8, "survived": 2}), Counter({"killed": 800, "survived": 200})
    low, high = mutation.confidence_interval(few)
    assert (low, high) == pytest.approx((0.490, 0.943), abs=1e-3)
    assert mutation.confidence_interval(many) == pytest.approx((0.774, 0.824), abs=1e-3)
