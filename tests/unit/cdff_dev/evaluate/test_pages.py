# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tables in the pages of the DFPCs are those of the figures that lie beside them."""

from __future__ import annotations

import json

import pytest

from cdff_common.errors import InputError
from cdff_dev.evaluate.__main__ import ROOT, evaluations, filled, folder_of

WITH_TABLES = [name for name, module in evaluations().items() if hasattr(module, "table")]


@pytest.mark.parametrize("name", WITH_TABLES)
def test_a_page_holds_the_tables_of_its_figures(name: str) -> None:
    figures = json.loads((ROOT / "docs" / "evaluation" / f"{name}.json").read_text(encoding="utf-8"))["figures"]
    subject = getattr(evaluations()[name], "PAGE", name)
    page = (folder_of(subject) / f"{subject}.md").read_text(encoding="utf-8")
    again = f"run: python -m cdff_dev.evaluate --draw-only {name}"
    assert filled(page, name, evaluations()[name].table(figures)) == page, again


def test_a_page_without_marks_is_named() -> None:
    page = "# x\n<!-- written by python -m cdff_dev.evaluate x -->\nold\n<!-- until here -->\nrest\n"
    assert filled(page, "x", "new") == page.replace("old", "new")
    with pytest.raises(InputError, match="page of y"):
        filled(page, "y", "new")
