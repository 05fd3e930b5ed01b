# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig, StrictModel
from cdff_common.interfaces.parameters import ParameterRow, parameter_rows


class _Inner(StrictModel):
    y: Annotated[float, Field(gt=0, description="metres")]


class _Part(StrictModel):
    x: int = 0
    inner: _Inner = _Inner(y=2.0)


class _Config(DfnConfig):
    window: Annotated[int, Field(ge=1, lt=50, description="beams on\n each side")] = 3
    limit_m: Annotated[float, Field(gt=0)] | None = None
    kind: Literal["a", "b"] = "a"
    corner_m: tuple[float, float, float]
    names: tuple[str, ...] = ()
    part: _Part = _Part(x=7)
    other: _Inner


def test_parameters_are_listed_with_type_default_bounds_and_meaning() -> None:
    rows = parameter_rows(_Config)
    assert [r.name for r in rows] == [
        *("window", "limit_m", "kind", "corner_m", "names", "part.x", "part.inner.y", "other.y")
    ]
    assert rows[0] == ParameterRow("window", "integer", "3", "≥ 1, < 50", "beams on each side")
    assert (rows[1].type, rows[1].default, rows[1].bounds) == ("number or null", "null", "> 0")
    assert rows[2].type == '"a" or "b"'
    assert (rows[3].type, rows[3].default) == ("3 x number", "required")
    assert rows[4].type == "list of string"


def test_nested_fields_are_listed_with_dotted_names_and_the_defaults_of_the_outermost_field() -> None:
    x, y, other = parameter_rows(_Config)[5:]
    assert x == ParameterRow("part.x", "integer", "7", "", "")
    assert y == ParameterRow("part.inner.y", "number", "2.0", "> 0", "metres")
    assert other.default == "required"


def test_configuration_without_fields_has_no_rows() -> None:
    assert parameter_rows(DfnConfig) == []
