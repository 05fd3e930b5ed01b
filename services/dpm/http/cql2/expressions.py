# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The JSON of CQL2 (OGC 21-065r2) as an expression of the store, with bounded size and checked types."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from cdff_common.clock import parse_rfc3339
from cdff_common.contract.limits import LATEST_NS
from cdff_common.errors import InputError
from dpm_store.search.filters import Call
from services.dpm.http.cql2.queryables import GEOMETRY, NUMBER, TEXT, TIME, Queryable, queryable

TEXT_LANGUAGE, JSON_LANGUAGE = "cql2-text", "cql2-json"
LANGUAGES = (TEXT_LANGUAGE, JSON_LANGUAGE)
#: Longest text of a filter; longer ones, such as those with large polygons, are sent as JSON.
MAX_TEXT = 20_000
#: Largest depth of an expression; largest numbers of its operators, of values in a list, of letters in a
#: value and of wildcards in a pattern.
_DEPTH, _OPERATORS, _LISTED, _LETTERS, _WILDCARDS = 20, 200, 1000, 1000, 8
_COMPARISONS = ("=", "<>", "<", "<=", ">", ">=")
_KINDS = {TEXT: "a text", NUMBER: "a number", TIME: "a time"}

#: Function that returns the expression of products that touch a GeoJSON geometry, or a ``bbox`` as
#: a list.
Touching = Callable[[Any], Any]


def parse_filter(data: Any, names: Mapping[str, Queryable], touching: Touching, language: str | None) -> Any:
    """Return the expression of a filter.

    Parameters
    ----------
    data : str or dict
        Text, or JSON.
    names : mapping of str to Queryable
    touching : callable
    language : str or None
        One of ``LANGUAGES``; None for that of the type of ``data``.

    Raises
    ------
    InputError
        If it is malformed, too large, or has an unknown property or a value of another type.
    """
    if language is not None and language not in LANGUAGES:
        raise InputError(f"filter-lang={language[:40]!r}: expected one of {', '.join(LANGUAGES)}")
    if language == TEXT_LANGUAGE and not isinstance(data, str):
        raise InputError("filter: expected a text, as filter-lang states")
    if isinstance(data, str):
        if language == JSON_LANGUAGE:
            data = _json_of(data)
        else:
            from services.dpm.http.cql2.text import parse_text  # the parser takes 0.1 s to import

            data = parse_text(data)
    return _Reader(names, touching).condition(data, 0)


def _json_of(text: str) -> Any:
    import json

    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"filter: expected CQL2 as JSON: {error}") from error


class _Reader:
    def __init__(self, names: Mapping[str, Queryable], touching: Touching) -> None:
        self._names = names
        self._touching = touching
        self._operators = 0

    def condition(self, data: Any, depth: int) -> Any:
        """Return the expression of a condition; raises InputError."""
        if isinstance(data, bool):
            return data
        op, args = self._call(data, depth)
        if op in ("and", "or"):
            if not args:
                raise InputError(f"filter: {op!r} without arguments")
            return Call(op, tuple(self.condition(argument, depth + 1) for argument in args))
        if op == "not":
            self._check_count(op, args, 1)
            return Call(op, (self.condition(args[0], depth + 1),))
        if op == "s_intersects":
            self._check_count(op, args, 2)
            return self._intersects(args)
        return self._predicate(op, args)

    def _predicate(self, op: str, args: list[Any]) -> Call:
        if op == "isNull":
            self._check_count(op, args, 1)
            return Call(op, (self._property(args[0])[0],))
        if op in _COMPARISONS:
            self._check_count(op, args, 2)
            if not _is_property(args[0]):  # a value before the property
                swapped = op.translate(str.maketrans("<>", "><")) if op != "<>" else op
                op, args = swapped, args[::-1]
            operand, kind = self._property(args[0])
            is_lower = isinstance(operand, Call)
            if _is_property(args[1]):
                other, other_kind = self._property(args[1])
                if other_kind != kind:
                    raise InputError(f"filter: {op} compares {_KINDS[kind]} with {_KINDS[other_kind]}")
                return Call(op, (operand, other))
            return Call(op, (operand, _value(args[1], kind, is_lower)))
        if op == "between":
            self._check_count(op, args, 3)
            operand, kind = self._property(args[0])
            if kind == TEXT:
                raise InputError("filter: between is for numbers and times")
            return Call(op, (operand, _value(args[1], kind), _value(args[2], kind)))
        if op == "in":
            self._check_count(op, args, 2)
            if not isinstance(args[1], list) or len(args[1]) > _LISTED:
                raise InputError(f"filter: in: expected a list of at most {_LISTED} values")
            operand, kind = self._property(args[0])
            is_lower = isinstance(operand, Call)
            return Call(op, (operand, tuple(_value(value, kind, is_lower) for value in args[1])))
        if op == "like":
            self._check_count(op, args, 2)
            operand, kind = self._property(args[0])
            if kind != TEXT:
                raise InputError("filter: like is for texts")
            pattern = _value(args[1], kind, isinstance(operand, Call))
            if sum(pattern.count(wildcard) for wildcard in "%_") > _WILDCARDS and "%" in pattern:
                raise InputError(f"filter: like: expected at most {_WILDCARDS} wildcards")
            return Call(op, (operand, pattern))
        raise InputError(
            f"filter: unknown operator {op[:40]!r}, expected one of and, or, not, {', '.join(_COMPARISONS)}, "
            "like, between, in, isNull, casei, s_intersects"
        )

    def _call(self, data: Any, depth: int) -> tuple[str, list[Any]]:
        self._operators += 1
        if depth > _DEPTH or self._operators > _OPERATORS:
            raise InputError(
                f"filter: expected at most {_OPERATORS} operators, and {_DEPTH} that contain each other"
            )
        if not isinstance(data, dict) or not isinstance(data.get("op"), str):
            raise InputError(f"filter: {str(data)[:80]!r}: expected an operator with its arguments")
        args = data.get("args")
        if not isinstance(args, list):
            raise InputError(f"filter: {data['op'][:40]!r}: expected args, a list")
        return data["op"], args

    def _property(self, data: Any) -> tuple[Any, str]:
        """Return a property as an expression, and its kind."""
        is_lower = isinstance(data, dict) and data.get("op") == "casei"
        if is_lower:
            _, args = self._call(data, 0)
            self._check_count("casei", args, 1)
            data = args[0]
        if not _is_property(data):
            raise InputError(f"filter: {str(data)[:80]!r}: expected a property")
        known = queryable(self._names, str(data["property"]))
        if not is_lower:
            return known.field, known.kind
        if known.kind != TEXT:
            raise InputError(f"filter: casei: {str(data['property'])[:40]!r} is not a text")
        return Call("lower", (known.field,)), TEXT

    def _intersects(self, args: list[Any]) -> Any:
        place, geometry = args if _is_property(args[0]) else args[::-1]
        if not _is_property(place) or place["property"].removeprefix("properties.") != GEOMETRY:
            raise InputError(f"filter: s_intersects: expected the property {GEOMETRY} and a geometry")
        if not isinstance(geometry, dict):
            raise InputError(f"filter: s_intersects: {str(geometry)[:80]!r}: expected a geometry")
        return self._touching(geometry["bbox"] if set(geometry) == {"bbox"} else geometry)

    @staticmethod
    def _check_count(op: str, args: list[Any], count: int) -> None:
        if len(args) != count:
            raise InputError(f"filter: {op} with {len(args)} arguments: expected {count}")


def _is_property(data: Any) -> bool:
    if isinstance(data, dict) and data.get("op") == "casei":
        args = data.get("args")
        return isinstance(args, list) and len(args) == 1 and _is_property(args[0])
    return isinstance(data, dict) and isinstance(data.get("property"), str)


def _value(data: Any, kind: str, is_lower: bool = False) -> Any:
    """Return a value of a kind as the store compares it; raises InputError."""
    if is_lower and isinstance(data, dict) and data.get("op") == "casei":
        args = data.get("args")
        data = args[0] if isinstance(args, list) and len(args) == 1 else None
    if isinstance(data, str) and len(data) > _LETTERS:
        raise InputError(f"filter: a text of {len(data)} letters, expected at most {_LETTERS}")
    if kind == TEXT and isinstance(data, str):
        return data.lower() if is_lower else data
    if kind == NUMBER and isinstance(data, int | float) and not isinstance(data, bool) and abs(data) < 1e300:
        return float(data)
    if kind == TIME:
        return _time_ns(data)
    raise InputError(f"filter: {str(data)[:80]!r}: expected {_KINDS[kind]}")


def _time_ns(data: Any) -> int:
    text = data
    if isinstance(data, dict) and len(data) == 1:
        text = data.get("timestamp", data.get("date"))
        if "date" in data and isinstance(text, str):
            text = f"{text}T00:00:00Z"
    if not isinstance(text, str):
        raise InputError(f"filter: {str(data)[:80]!r}: expected a time")
    stamp_ns = parse_rfc3339(text, "filter")
    if abs(stamp_ns) > LATEST_NS:
        raise InputError(f"filter: {text[:40]!r}: expected times before the year 2116")
    return stamp_ns
