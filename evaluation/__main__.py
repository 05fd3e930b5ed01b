# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``python -m evaluation [NAME[:PART] ...]``: run evaluations, write results, diagrams and tables.

``make evaluate`` runs all evaluations, ``python -m evaluation real`` those on measured data that are part of
the table ``docs/evaluation/real.md``.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import pkgutil
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import evaluation
from cdff_common.cli import run_safely
from cdff_common.errors import InputError
from evaluation import distributed, real
from evaluation.record import provenance, write

ROOT = Path(__file__).resolve().parents[1]
#: Pages with the diagrams and tables of the evaluations.
PAGES = ROOT / "docs" / "evaluation"


def evaluations() -> dict[str, ModuleType]:
    """Return the modules of this package that have a function ``evaluate``, by name."""
    modules = {
        info.name: importlib.import_module(f"{evaluation.__name__}.{info.name}")
        for info in pkgutil.iter_modules(evaluation.__path__)
        if not info.name.startswith("_")
    }
    return {name: module for name, module in modules.items() if hasattr(module, "evaluate")}


def main(argv: list[str] | None = None) -> int:
    """Run the named evaluations, or all."""
    parser = argparse.ArgumentParser(prog="evaluate", description=__doc__)
    parser.add_argument(
        "names", nargs="*", help="evaluations (NAME), or parts of evaluations (NAME:PART); default: all"
    )
    parser.add_argument(
        "--draw-only", action="store_true", help="update diagrams and tables from the existing JSON files"
    )
    parser.add_argument(
        "--draft", action="store_true", help="print the results only; also with uncommitted changes"
    )
    parser.add_argument("--data", type=Path, help="folder of the real data sets; CDFF_DATA, ../shared/data")
    parser.add_argument("--seed", type=int, help="seed of the sample, for evaluations that draw one")
    parser.add_argument("--count", type=int, help="size of the sample, for evaluations that draw one")
    parser.add_argument("--figures", type=Path, help="write the results to this file instead of the records")
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="execute the evaluations on the workers of a scheduler of Dask, with this folder in common",
    )
    parser.add_argument("--module", help="file of which mutation draws all mutants; with --draft only")
    args = parser.parse_args(argv)
    if args.module and not args.draft:
        raise InputError(f"--module {args.module}: not a sample of the whole code, expected --draft")
    data = args.data or Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared" / "data")
    if not data.is_dir():
        raise InputError(f"real data {data}: not a folder; name it with --data or CDFF_DATA")
    available = evaluations()
    args.names = [
        member for name in args.names for member in (real.members(available) if name == real.NAME else [name])
    ]
    for name, part in map(_split, args.names):
        if name not in available:
            raise InputError(f"no evaluation {name!r}; known are {', '.join(available)}")
        parts = getattr(available[name], "PARTS", ())
        if part and part not in parts:
            raise InputError(f"evaluation {name}: no part {part!r}; expected {', '.join(parts) or 'none'}")
    if args.draw_only:
        for name, _ in map(_split, args.names or available):
            path = PAGES / f"{name}.json"
            if path.is_file():
                _draw(available[name], name, json.loads(path.read_text(encoding="utf-8"))["figures"])
        _draw_real(available)
        return 0
    origin = provenance(ROOT)
    if args.figures and len(args.names) != 1:
        raise InputError("--figures: expected the name of one evaluation")
    if origin["tree_differs"] and not (args.draft or args.figures):
        raise InputError(
            "evaluation: the tree has uncommitted changes outside docs: expected a commit that the records "
            "can name; --draft prints the results without writing them"
        )
    figures_of = {}
    if args.dask:
        figures_of = distributed.figures(ROOT, list(args.names or available), data, args, origin)
    for name, part in map(_split, args.names or available):
        options = {"parts": (part,)} if part else {}
        options |= _options(available[name], args)
        figures = figures_of.get(f"{name}:{part}" if part else name)
        if figures is None:
            figures = available[name].evaluate(data, _show_progress, **options)
        if args.figures:
            args.figures.write_text(json.dumps(figures), encoding="utf-8")
            return 0
        sys.stdout.write(f"{name}: {json.dumps(figures)}\n")
        if args.draft:
            continue
        path = write(ROOT, name, figures, part, origin)
        sys.stdout.write(f"wrote {path.relative_to(ROOT)}\n")
        _draw(available[name], name, json.loads(path.read_text(encoding="utf-8"))["figures"])
    if not args.draft:
        _draw_real(available)
    return 0


def _options(module: ModuleType, args: argparse.Namespace) -> dict[str, Any]:
    """Return the given options that an evaluation has; its ``OPTIONS`` are their names and defaults."""
    names = getattr(module, "OPTIONS", {})
    return {name: value for name in names if (value := getattr(args, name)) is not None}


def _draw_real(available: dict[str, ModuleType]) -> None:
    """Write the table of results on real sensors."""
    page = PAGES / f"{real.NAME}.md"
    page.write_text(
        filled(page.read_text(encoding="utf-8"), real.NAME, real.table(available, real_figures(available))),
        encoding="utf-8",
    )
    sys.stdout.write(f"wrote docs/evaluation/{page.name}\n")


def real_figures(available: dict[str, ModuleType]) -> dict[str, dict[str, Any]]:
    """Return the recorded results of the evaluations that are part of the table of real sensors."""
    return {
        name: json.loads((PAGES / f"{name}.json").read_text(encoding="utf-8"))["figures"]
        for name in real.members(available)
    }


def _split(name: str) -> tuple[str, str]:
    """Split ``name:part`` into the names of the evaluation and its part."""
    evaluation, _, part = name.partition(":")
    return evaluation, part


def _draw(module: ModuleType, name: str, figures: dict[str, Any]) -> None:
    """Write the SVG of ``draw(figures) -> bytes`` and the tables of ``table(figures) -> str``.

    The page is ``docs/evaluation/{name}.md``; a module that adds to the page of another one names it in
    ``PAGE``.
    """
    if hasattr(module, "draw"):
        (PAGES / f"{name}.svg").write_bytes(module.draw(figures))
        sys.stdout.write(f"wrote docs/evaluation/{name}.svg\n")
    if hasattr(module, "table"):
        page = PAGES / f"{getattr(module, 'PAGE', name)}.md"
        page.write_text(
            filled(page.read_text(encoding="utf-8"), name, module.table(figures)), encoding="utf-8"
        )
        sys.stdout.write(f"wrote docs/evaluation/{page.name}\n")


def filled(page: str, name: str, table: str) -> str:
    """Return the page with the text between the markers of an evaluation replaced.

    Raises
    ------
    InputError
        If the page has no such markers.
    """
    start_marker, end_marker = f"<!-- written by python -m evaluation {name} -->\n", "<!-- until here -->\n"
    if page.count(start_marker) != 1 or end_marker not in page[page.index(start_marker) :]:
        raise InputError(
            f"page of {name}: expected one line {start_marker.strip()} and a line {end_marker.strip()} "
            "after it"
        )
    start = page.index(start_marker) + len(start_marker)
    return page[:start] + table.rstrip() + "\n" + page[page.index(end_marker, start) :]


def _show_progress(text: str) -> None:
    """Replace the progress line on a terminal."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{text:70}")
        sys.stderr.flush()


if __name__ == "__main__":
    raise SystemExit(run_safely(main))
