# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``python -m cdff_dev.evaluate [NAME[:PART] ...]``: run evaluations and write figures; ``make evaluate`` runs all."""

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

from cdff_common.cli import run_safely
from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_dev import evaluate
from cdff_dev.evaluate.record import write

ROOT = Path(__file__).resolve().parents[2]


def evaluations() -> dict[str, ModuleType]:
    """Modules of this package that evaluate something, by name."""
    modules = {
        info.name: importlib.import_module(f"{evaluate.__name__}.{info.name}")
        for info in pkgutil.iter_modules(evaluate.__path__)
        if not info.name.startswith("_")
    }
    return {name: module for name, module in modules.items() if hasattr(module, "evaluate")}


def main(argv: list[str] | None = None) -> int:
    """Run them all, or those named."""
    parser = argparse.ArgumentParser(prog="evaluate", description=__doc__)
    parser.add_argument("names", nargs="*", help="evaluations, or one part of one that has parts (default: all)")
    parser.add_argument("--draw-only", action="store_true", help="draw the figures of the JSON that is there again")
    parser.add_argument("--data", type=Path, help="folder of the real data sets; CDFF_DATA, ../shared/data")
    args = parser.parse_args(argv)
    data = args.data or Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared" / "data")
    if not data.is_dir():
        raise InputError(f"real data {data}: not a folder; name it with --data or CDFF_DATA")
    known = evaluations()
    for name, part in map(_split, args.names):
        if name not in known:
            raise InputError(f"no evaluation {name!r}; known are {', '.join(known)}")
        parts = getattr(known[name], "PARTS", ())
        if part and part not in parts:
            raise InputError(f"evaluation {name}: no part {part!r}; expected {', '.join(parts) or 'none'}")
    if args.draw_only:
        for name, _ in map(_split, args.names or known):
            path = ROOT / "docs" / "evaluation" / f"{name}.json"
            if path.is_file():
                _draw(known[name], name, json.loads(path.read_text(encoding="utf-8"))["figures"])
        return 0
    for name, part in map(_split, args.names or known):
        figures = known[name].evaluate(data, _say, **({"parts": (part,)} if part else {}))
        path = write(ROOT, name, figures, part)
        sys.stdout.write(f"{name}: {json.dumps(figures)}\nwrote {path.relative_to(ROOT)}\n")
        _draw(known[name], name, json.loads(path.read_text(encoding="utf-8"))["figures"])
    return 0


def _split(name: str) -> tuple[str, str]:
    """Evaluation and part of ``name:part``."""
    evaluation, _, part = name.partition(":")
    return evaluation, part


def _draw(module: ModuleType, name: str, figures: dict[str, Any]) -> None:
    """Put the SVG of ``draw(figures) -> bytes`` beside its page and the tables of ``table(figures) -> str`` into it.

    The page is that of what is evaluated; a module that evaluates more of the same names it in ``PAGE``.
    """
    subject = getattr(module, "PAGE", name)
    folder = folder_of(subject)
    if hasattr(module, "draw"):
        (folder / f"{name}.svg").write_bytes(module.draw(figures))
        sys.stdout.write(f"wrote docs/{folder.name}/{name}.svg\n")
    if hasattr(module, "table"):
        page = folder / f"{subject}.md"
        page.write_text(filled(page.read_text(encoding="utf-8"), name, module.table(figures)), encoding="utf-8")
        sys.stdout.write(f"wrote docs/{folder.name}/{subject}.md\n")


def folder_of(name: str) -> Path:
    """Folder of the page of what is evaluated: a DFN, a DFPC, or what a how-to tells of."""
    if (ROOT / "docs" / "how-to" / f"{name}.md").is_file():
        return ROOT / "docs" / "how-to"
    return ROOT / "docs" / ("dfns" if name in Registry.default().dfns else "dfpcs")


def filled(page: str, name: str, table: str) -> str:
    """The page with its text between the marks of an evaluation replaced; raises InputError where it has no marks."""
    first, last = f"<!-- written by python -m cdff_dev.evaluate {name} -->\n", "<!-- until here -->\n"
    if page.count(first) != 1 or last not in page[page.index(first) :]:
        raise InputError(f"page of {name}: expected one line {first.strip()} and a line {last.strip()} after it")
    begin = page.index(first) + len(first)
    return page[:begin] + table.rstrip() + "\n" + page[page.index(last, begin) :]


def _say(text: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{text:70}")
        sys.stderr.flush()


if __name__ == "__main__":
    raise SystemExit(run_safely(main))
