# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check the language of docstrings, comments, messages, YAML files and pages against ``scripts/prose.yaml``.

``prose.py [PATH ...]`` checks tracked files below the paths (default: all) and prints one line per finding.
``prose.py --count`` prints the number of findings for each top-level folder.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import yaml

ROOT = Path(__file__).resolve().parent.parent
RULES = Path(__file__).with_suffix(".yaml")
#: Generated pages, whose sources are checked, lock files, and the phrases themselves.
EXCLUDED = ("docs/reference/", "requirements/", "scripts/prose.yaml", "tests/unit/scripts/test_prose.py")
SUFFIXES = (".py", ".yaml", ".yml", ".md", ".asn", ".j2", ".toml", ".html", ".js")
MIN_WORDS = 3


class Finding(NamedTuple):
    """A phrase that the rules refuse, with its location and replacement."""

    path: str
    line: int
    phrase: str
    use: str


def main() -> int:
    """Print every finding; exit 1 if there is one."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("paths", nargs="*", help="files or folders (default: every tracked file)")
    parser.add_argument("--count", action="store_true", help="findings for each top-level folder only")
    args = parser.parse_args()
    rules = yaml.safe_load(RULES.read_text(encoding="utf-8"))
    files = _tracked(args.paths)
    with ProcessPoolExecutor() as pool:
        found = pool.map(partial(_findings, rules=rules), files, chunksize=64)
        findings = [finding for in_file in found for finding in in_file]
    findings += check_layout([path for path in _tracked([]) if path.endswith(".py")], rules["limits"])
    if args.count:
        for folder, count in sorted(Counter(f.path.split("/")[0] for f in findings).items()):
            print(f"{count:6d} {folder}")
    else:
        for finding in findings:
            print(f"{finding.path}:{finding.line}: {finding.phrase!r}: use {finding.use}")
    print(f"prose: {len(findings)} findings in {len(files)} files")
    return 1 if findings else 0


def _findings(path: str, rules: dict[str, Any]) -> list[Finding]:
    return list(check_file(path, rules))


def check_file(path: str, rules: dict[str, Any]) -> Iterator[Finding]:
    """Return the findings in one file."""
    text = (ROOT / path).read_text(encoding="utf-8")
    pattern = re.compile(
        "|".join(f"(?P<p{i}>{rule['pattern']})" for i, rule in enumerate(rules["phrases"])), re.IGNORECASE
    )
    if path.endswith(".py"):
        starts = re.compile(rf"(?:{'|'.join(rules['summary_starts'])})\b")
        passages = _python_passages(text)
    else:
        starts = None
        passages = _page_passages(text) if path.endswith(".md") else ((1, text, False),)
    for first_line, passage, is_docstring in passages:
        if is_docstring and starts and starts.match(passage.lstrip()):
            start = passage.split()[0]
            yield Finding(path, first_line, start, "a summary that starts with what the thing is or does")
        for match in pattern.finditer(passage):
            line = first_line + passage.count("\n", 0, match.start())
            if match.group() in rules["allowed"]:
                continue
            rule = rules["phrases"][int((match.lastgroup or "p0")[1:])]
            yield Finding(path, line, " ".join(match.group().split()), rule["use"])


def check_layout(paths: list[str], limits: dict[str, int]) -> Iterator[Finding]:
    """Return a finding if the tree has too many unformatted statements or long lines."""
    lines = [line for path in paths for line in (ROOT / path).read_text(encoding="utf-8").splitlines()]
    counts = {
        "fmt_skip": sum("fmt: " + "skip" in line for line in lines),
        "long_lines": sum(len(line) > limits["line_length"] for line in lines),
    }
    for name, count in counts.items():
        if count > limits[name]:
            yield Finding("(tree)", 0, f"{count} {name}", f"at most {limits[name]}")


def _tracked(paths: list[str]) -> list[str]:
    command = ["git", "ls-files", "--", *paths]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    return [
        path
        for path in listed
        if path.endswith(SUFFIXES) and not path.startswith(EXCLUDED) and (ROOT / path).is_file()
    ]


def _python_passages(text: str) -> Iterator[tuple[int, str, bool]]:
    """Yield line, text and kind of every comment block, docstring and message of a module."""
    tree = ast.parse(text)
    docstrings = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.body:
            first = node.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                docstrings.add(id(first.value))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            is_docstring = id(node) in docstrings  # its definition comes earlier in the walk
            if is_docstring or len(node.value.split()) >= MIN_WORDS:
                yield node.lineno, node.value, is_docstring
    block: list[str] = []
    start = end = 0
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            if block and token.start[0] != end + 1:
                yield start, "\n".join(block), False
                block = []
            if not block:
                start = token.start[0]
            block.append(token.string.lstrip("#: "))
            end = token.start[0]
    if block:
        yield start, "\n".join(block), False


def _page_passages(text: str) -> Iterator[tuple[int, str, bool]]:
    """Yield the text of a page without its code."""
    blanked = re.sub(
        r"^```.*?^```|`[^`\n]+`", lambda m: "\n" * m.group().count("\n"), text, flags=re.DOTALL | re.MULTILINE
    )
    yield 1, blanked, False


if __name__ == "__main__":
    sys.exit(main())
