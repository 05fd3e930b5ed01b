# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The interface documents list the parameters, products, states and error codes of the code."""

from __future__ import annotations

import re
from pathlib import Path

from cdff_common.contract.products import requestable_products
from cdff_common.contract.queries import RequestParameters
from cdff_common.errors import ERROR_OF_CODE
from cdff_core.orchestration.modes import MODE_TRANSITIONS

DOCS = Path(__file__).resolve().parents[2] / "docs"
OG2 = (DOCS / "og2-interface.md").read_text(encoding="utf-8")
ICU = (DOCS / "icu-interface.md").read_text(encoding="utf-8")


def edges(text: str) -> set[tuple[str, str]]:
    """Return the edges (from, to) of a Mermaid state diagram."""
    return set(re.findall(r"^ +(\w+) --> (\w+)", text, re.MULTILINE))


def test_every_parameter_product_type_and_format_is_documented() -> None:
    names = {field.alias or name for name, field in RequestParameters.model_fields.items()}
    for name in names - {"robot"}:
        assert f"`{name}`" in OG2, name
    for product in requestable_products().values():
        for word in (product.name, *product.types, *product.formats):
            assert re.search(rf"\b{word}\b", OG2), word


def test_every_error_code_is_documented() -> None:
    for code in ERROR_OF_CODE:
        assert f"`{code}`" in OG2, code


def test_the_diagram_of_sensor_modes_matches_the_transition_table() -> None:
    assert edges(ICU) == {(state, next_state) for (state, _), next_state in MODE_TRANSITIONS.items()}
