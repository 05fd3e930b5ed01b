# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tutorial on C, C++ and JavaScript: its Python code runs and its JavaScript reads the messages."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

_ROOT = Path(__file__).resolve().parents[2]
_PAGE = _ROOT / "docs" / "tutorials" / "exchange-types.md"
_JAVASCRIPT = _ROOT / "examples" / "exchange" / "javascript"
_SNIPPETS = re.findall(r"```python\n(.*?)```", _PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_the_first_snippet_writes_the_files_named_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(_SNIPPETS[0], str(_PAGE), "exec"), {})
    assert {p.name for p in tmp_path.iterdir()} == {"pose.uper", "pose.ber", "pose.msgpack"}
    assert len(_SNIPPETS) == 2


def test_programs_named_on_the_page_exist() -> None:
    paths = set(re.findall(r"examples/exchange/[\w/.]+", _PAGE.read_text(encoding="utf-8")))
    assert paths
    for path in paths:
        assert (_ROOT / path).exists(), path


@pytest.mark.skipif(
    shutil.which("node") is None or not (_JAVASCRIPT / "node_modules").is_dir(),
    reason="node, or npm install in examples/exchange/javascript, is missing",
)
@pytest.mark.parametrize("codec", ["ber", "msgpack"])
def test_javascript_prints_the_output_shown_on_the_page(
    codec: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(_SNIPPETS[0], str(_PAGE), "exec"), {})
    command = ["node", str(_JAVASCRIPT / "transform.mjs"), str(tmp_path / f"pose.{codec}")]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    output_on_page = _PAGE.read_text(encoding="utf-8").split("Both print\n`")[1].split("`")[0]
    assert json.loads(result.stdout) == json.loads(output_on_page)
