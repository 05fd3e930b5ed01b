# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tables in the pages of the DFPCs are generated from the recorded results."""

from __future__ import annotations

import json

import pytest

from cdff_common.errors import InputError
from evaluation import real
from evaluation.__main__ import PAGES, evaluations, filled, real_figures

WITH_TABLES = [name for name, module in evaluations().items() if hasattr(module, "table")]


@pytest.mark.parametrize("name", WITH_TABLES)
def test_a_page_has_the_tables_of_its_results(name: str) -> None:
    subject, record = getattr(evaluations()[name], "PAGE", name), PAGES / f"{name}.json"
    page = (PAGES / f"{subject}.md").read_text(encoding="utf-8")
    table = "Not recorded yet."
    if record.is_file():
        table = evaluations()[name].table(json.loads(record.read_text(encoding="utf-8"))["figures"])
    assert filled(page, name, table) == page, f"run: python -m evaluation --draw-only {name}"


def test_the_table_of_real_sensors_has_the_recorded_results() -> None:
    available = evaluations()
    page = (PAGES / "real.md").read_text(encoding="utf-8")
    assert len(real.members(available)) >= 9
    assert filled(page, real.NAME, real.table(available, real_figures(available))) == page


def test_a_page_without_table_markers_is_refused() -> None:
    page = "# x\n<!-- written by python -m evaluation x -->\nold\n<!-- until here -->\nrest\n"
    assert filled(page, "x", "new") == page.replace("old", "new")
    with pytest.raises(InputError, match="page of y"):
        filled(page, "y", "new")
