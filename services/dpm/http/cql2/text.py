# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The text of CQL2 as the JSON of CQL2 (OGC 21-065r2).

The parser is a table (LALR), which needs no more stack for deep nesting.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from lark import Lark, Transformer, v_args
from lark.exceptions import UnexpectedInput

from cdff_common.errors import InputError
from services.dpm.http.cql2.expressions import MAX_TEXT

_DIMENSIONS = ("Point", "LineString", "Polygon", "MultiPoint", "MultiLineString", "MultiPolygon")
_SHAPES = {name.upper(): name for name in (*_DIMENSIONS, "GeometryCollection")}


def parse_text(text: str) -> Any:
    """Return the JSON form of a filter.

    Raises
    ------
    InputError
        With the place at which the text is not CQL2.
    """
    if len(text) > MAX_TEXT:
        raise InputError(f"filter of {len(text)} characters: expected at most {MAX_TEXT}")
    try:
        return _parser().parse(text)
    except UnexpectedInput as error:
        position = getattr(error, "pos_in_stream", None)
        place = len(text) if position is None or position < 0 else position
        raise InputError(
            f"filter: expected CQL2 text; it ends or is not understood at character {place}, "
            f"{text[place : place + 20]!r}"
        ) from error


@functools.cache
def _parser() -> Lark:
    grammar = Path(__file__).with_name("cql2.lark").read_text("utf-8")
    return Lark(grammar, parser="lalr", transformer=_ToJson())


def _call(op: str, *args: Any) -> dict[str, Any]:
    return {"op": op, "args": list(args)}


@v_args(inline=True)
class _ToJson(Transformer[Any, Any]):
    """Actions of the grammar's rules."""

    def any_of(self, *args: Any) -> Any:
        return _call("or", *args) if len(args) > 1 else args[0]

    def all_of(self, *args: Any) -> Any:
        return _call("and", *args) if len(args) > 1 else args[0]

    def negated(self, argument: Any) -> Any:
        return _call("not", argument)

    def comparison(self, left: Any, op: str, right: Any) -> Any:
        return _call(str(op), left, right)

    def like(self, left: Any, right: Any) -> Any:
        return _call("like", left, right)

    def not_like(self, left: Any, right: Any) -> Any:
        return _call("not", self.like(left, right))

    def between(self, value: Any, low: Any, high: Any) -> Any:
        return _call("between", value, low, high)

    def not_between(self, value: Any, low: Any, high: Any) -> Any:
        return _call("not", self.between(value, low, high))

    def one_of(self, value: Any, *listed: Any) -> Any:
        return _call("in", value, list(listed))

    def not_one_of(self, value: Any, *listed: Any) -> Any:
        return _call("not", self.one_of(value, *listed))

    def missing(self, value: Any) -> Any:
        return _call("isNull", value)

    def present(self, value: Any) -> Any:
        return _call("not", self.missing(value))

    def intersects(self, left: Any, right: Any) -> Any:
        return _call("s_intersects", left, right)

    def true(self, _: Any) -> Any:
        return True

    def false(self, _: Any) -> Any:
        return False

    def name(self, token: str) -> Any:
        return {"property": str(token)}

    def quoted_name(self, token: str) -> Any:
        return {"property": token[1:-1]}

    def string(self, token: str) -> Any:
        return _unquoted(token)

    def number(self, token: str) -> Any:
        return _number(token)

    def timestamp(self, token: str) -> Any:
        return {"timestamp": _unquoted(token)}

    def date(self, token: str) -> Any:
        return {"date": _unquoted(token)}

    def lower(self, value: Any) -> Any:
        return _call("casei", value)

    def bbox(self, *numbers: str) -> Any:
        return {"bbox": [float(number) for number in numbers]}

    def position(self, *numbers: str | None) -> Any:
        return [float(number) for number in numbers if number is not None]

    def coordinates(self, *items: Any) -> Any:
        return list(items)

    def shape(self, token: str, coordinates: Any) -> Any:
        kind = _SHAPES[token.upper().removesuffix("Z").strip()]
        if kind == "GeometryCollection":
            return {"type": kind, "geometries": coordinates}
        if kind == "Point":
            coordinates = coordinates[0]
        elif kind == "MultiPoint":  # each point may be in parentheses
            coordinates = [item[0] if isinstance(item[0], list) else item for item in coordinates]
        return {"type": kind, "coordinates": coordinates}


def _number(token: str) -> int | float:
    return int(token) if token.lstrip("+-").isdecimal() and len(token) < 19 else float(token)


def _unquoted(token: str) -> str:
    return token[1:-1].replace("''", "'").replace("\\'", "'")
