# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The notebooks of the documentation run, have the outputs of today's code, and are shown by the site."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from scripts.notebook import execute, markdown_of, on_page_markdown, shown_texts

TUTORIALS = Path(__file__).resolve().parents[3] / "docs" / "tutorials"
NOTEBOOK = TUTORIALS / "values.ipynb"
#: Largest stored notebook, bytes.
LIMIT = 500_000


def test_the_page_shows_the_cells_and_outputs_of_its_notebook() -> None:
    page = SimpleNamespace(file=SimpleNamespace(abs_src_path=str(TUTORIALS / "values.md")))
    text = on_page_markdown((TUTORIALS / "values.md").read_text(encoding="utf-8"), page=page)
    assert "<!--" not in text
    assert "```python\nsweep.plot()\n```" in text
    assert text.count('src="data:image/png;base64,') == 3
    assert "124668 points" in text


def test_a_notebook_is_small_and_has_an_output_for_each_cell() -> None:
    assert NOTEBOOK.stat().st_size < LIMIT
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert all(cell["outputs"] for cell in cells if cell["cell_type"] == "code")


def test_an_output_is_shown_as_picture_html_or_text() -> None:
    outputs = [{"data": {"image/png": "QUJD\n"}}, {"data": {"text/html": ["<b>1</b>\n", "\n2"]}}]
    outputs.append({"data": {"text/plain": "x < 1"}})
    cell = {"cell_type": "code", "source": ["a = 1"], "outputs": outputs}
    assert markdown_of({"cells": [cell]}).split("\n\n") == [
        "```python\na = 1\n```",
        '<img alt="Output" src="data:image/png;base64,QUJD">',
        "<b>1</b> 2",
        "```text\nx < 1\n```",
    ]


def test_the_sign_of_a_rounded_zero_is_not_compared() -> None:
    def shown(text: str) -> list[str]:
        return shown_texts({"cells": [{"outputs": [{"data": {"text/plain": [text]}}]}]})

    assert shown("0.000 -0.000  -0.014") == shown("0.000  0.000  -0.014")
    assert shown("-0.001") != shown(" 0.001")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["values.ipynb"])
def test_a_notebook_has_the_outputs_of_a_new_execution(
    name: str, real_data: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CDFF_DATA", str(real_data("kitti_velodyne").parent))
    monkeypatch.setenv("PYTHONPATH", str(TUTORIALS.parents[1]))
    stored = json.loads((TUTORIALS / name).read_text(encoding="utf-8"))
    assert shown_texts(execute(TUTORIALS / name)) == shown_texts(stored)
