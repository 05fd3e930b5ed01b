# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

BENCHMARKS = sorted((Path(__file__).resolve().parents[3] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("path", BENCHMARKS, ids=lambda p: p.stem)
def test_a_usage_line_names_existing_options(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    usage = [
        line
        for line in (ast.get_docstring(ast.parse(text)) or "").splitlines()
        if "python benchmarks/" in line
    ]
    options = set(re.findall(r"--[a-z-]+", " ".join(usage)))
    assert options <= set(re.findall(r"add_argument\(\s*\"(--[a-z-]+)\"", text))
