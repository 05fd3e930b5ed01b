# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mutation test: the tests run on code with one small change; a change that no test notices survives.

The mutants are a random sample of the numerics and of the decision code. Each runs against the tests that are
nearest to the changed function, in a copy of the tree.
"""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Callable, Iterator
from hashlib import blake2b
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from cdff_common.errors import InputError
from evaluation.runs.mutants import Mutant, mutants
from evaluation.runs.mutation_progress import MutationProgress
from evaluation.runs.mutation_tests import MutationTests

OPTIONS = {"seed": 1, "count": 200, "module": ""}
ROOT = Path(__file__).resolve().parents[1]
#: Mutants that change no result, with the reason, by ``Mutant.key``.
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.json")
#: Share of the sample and folders of each part of the code.
PARTS_OF_CODE: dict[str, tuple[float, tuple[str, ...]]] = {
    "algorithms": (0.5, ("cdff_core/dfns", "cdff_core/dfpcs", "cdff_core/imaging", "cdff_core/cloud_matching",
                         "cdff_core/elevation", "cdff_core/map_merging", "cdff_core/partial_views")),
    "geometry": (0.1, ("cdff_common/geometry",)),
    "product store": (0.15, ("dpm_store",)),
    "decisions": (0.25, ("cdff_core/orchestration", "cdff_core/runtime", "services/orchestrator",
                         "services/dpm/operations", "services/dpm/queries")),
}  # fmt: skip
_NOT_SAMPLED = {"commands.py", "__main__.py", "migrations"}
#: Text in generated files, which are not mutated: ``cdff generate --check`` of the continuous integration
#: finds any change.
_GENERATED = b"# GENERATED from"


def evaluate(
    data: Path, progress: Callable[[str], None], seed: int = 1, count: int = 200, module: str = ""
) -> dict[str, Any]:
    """Return the outcome of each sampled mutant: killed, timeout, survived or equivalent.

    With ``module``, a file relative to the root of the tree, all mutants are from this file.
    """
    equivalent = json.loads(EQUIVALENT.read_text(encoding="utf-8"))
    known = MutationProgress(ROOT)
    results = []
    with MutationTests(ROOT) as tests:
        for number, (part, mutant) in enumerate(sample(ROOT, seed, count, module)):
            progress(f"mutation: {number + 1} of {count}, {mutant.path}")
            answer = known.answer(mutant.key) or known.add(mutant.key, tests.run(mutant))
            row: dict[str, Any] = {"part": part, "line": mutant.line, "mutant": mutant.key} | answer
            if row["outcome"] == "survived" and mutant.key in equivalent:
                row |= {"outcome": "equivalent", "reason": equivalent[mutant.key]}
            results.append(row)
        tests.check_without_change(row["test"] for row in results)
    counts = Counter(row["outcome"] for row in results)
    return {
        "seed": seed,
        "count": len(results),
        "module": module,
        "killed_ratio": killed_ratio(counts),
        "mutants": results,
    }


def sample(root: Path, seed: int, count: int, module: str = "") -> Iterator[tuple[str, Mutant]]:
    """Yield ``count`` mutants with their part of the code; a smaller sample is the start of a larger one.

    With ``module``, the mutants are from this file, fewer than ``count`` if it has no more.

    Raises
    ------
    InputError
        If the module is not a Python file of a part of the code.
    """
    if module:
        part = _part_of(root, module)
        for mutant in itertools.islice(_drawn(root, [module], f"{seed} {module}"), count):
            yield part, mutant
        return
    mutants_by_part = {part: _drawn(root, _files(root, part), f"{seed} {part}") for part in PARTS_OF_CODE}
    sizes = dict.fromkeys(PARTS_OF_CODE, 0)
    for number in range(1, count + 1):
        part = max(sizes, key=lambda p: PARTS_OF_CODE[p][0] * number - sizes[p])
        sizes[part] += 1
        yield part, next(mutants_by_part[part])


def _files(root: Path, part: str) -> list[str]:
    """Return the files of a part of the code that are sampled, relative to the root of the tree."""
    files = sorted(file for folder in PARTS_OF_CODE[part][1] for file in (root / folder).rglob("*.py"))
    names = [file.relative_to(root) for file in files if _GENERATED not in file.read_bytes()[:400]]
    return [str(name) for name in names if not _NOT_SAMPLED & {*name.parts}]


def _part_of(root: Path, module: str) -> str:
    """Return the part of the code that a file belongs to."""
    for part in PARTS_OF_CODE:
        if module in _files(root, part):
            return part
    raise InputError(
        f"module {module!r}: expected a Python file of a part of the code, such as "
        f"{_files(root, next(iter(PARTS_OF_CODE)))[0]}"
    )


def _drawn(root: Path, files: list[str], seed: str) -> Iterator[Mutant]:
    """Yield the valid mutants of files in random order.

    A change of a function changes the positions of its own mutants only.
    """
    sources = {name: (root / name).read_bytes() for name in files}
    candidates = [mutant for path, source in sources.items() for mutant in mutants(path, source)]
    candidates.sort(key=lambda mutant: blake2b(f"{seed} {mutant.key}".encode()).digest())
    yield from (mutant for mutant in candidates if _is_valid(mutant, sources[mutant.path]))


def _is_valid(mutant: Mutant, source: bytes) -> bool:
    try:
        mutant.applied(source)
    except SyntaxError:
        return False
    return True


def killed_ratio(counts: Counter[str]) -> float:
    """Return the ratio of the mutants that are not equivalent and that a test or the time limit stops."""
    killed = counts["killed"] + counts["timeout"]
    return round(killed / max(killed + counts["survived"], 1), 3)


def confidence_interval(counts: Counter[str]) -> tuple[float, float]:
    """Return the limits of the killed ratio of all mutants with 95 % confidence.

    E. B. Wilson, Probable Inference, the Law of Succession, and Statistical Inference, 1927,
    doi:10.1080/01621459.1927.10502953
    """
    killed = counts["killed"] + counts["timeout"]
    limits = binomtest(killed, max(killed + counts["survived"], 1)).proportion_ci(0.95, method="wilson")
    return float(limits.low), float(limits.high)


def table(figures: dict[str, Any]) -> str:
    """Return the counts of each part of the code and of each operator, and the survivors."""
    rows = figures["mutants"]
    low, high = confidence_interval(Counter(row["outcome"] for row in rows))
    lines = [
        f"{figures['killed_ratio']:.1%} of the mutants that are not equivalent are killed "
        f"({len(rows)} mutants, seed {figures['seed']}); of all mutants, {low:.0%} to {high:.0%} with 95 % "
        "confidence.",
        "",
    ]
    for title, key in (("part of the code", lambda r: r["part"]), ("operator", _operator)):
        lines += [f"| {title} | mutants | killed | of these by time | survived | equivalent | ratio |"]
        lines += ["|---|---|---|---|---|---|---|"]
        for name in sorted({key(row) for row in rows}):
            counts = Counter(row["outcome"] for row in rows if key(row) == name)
            killed = counts["killed"] + counts["timeout"]
            values = (counts.total(), killed, counts["timeout"], counts["survived"], counts["equivalent"])
            lines.append(f"| {name} | {' | '.join(map(str, values))} | {killed_ratio(counts):.0%} |")
        lines.append("")
    for outcome in ("survived", "equivalent"):
        lines += [f"**{outcome.capitalize()}**", ""]
        lines += [_item(row) for row in rows if row["outcome"] == outcome] or ["None."]
        lines.append("")
    return "\n".join(lines)


def _operator(row: dict[str, Any]) -> str:
    return str(row["mutant"]).split("::", 1)[1].split(" ", 1)[1].split(" #")[0]


def _item(row: dict[str, Any]) -> str:
    path, change = row["mutant"].split("::", 1)
    reason = f": {row['reason']}" if "reason" in row else ""
    return f"- `{path}` line {row['line']}, `` {change} ``{reason}"
