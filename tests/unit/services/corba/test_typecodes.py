# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values that state their type: they are equal after their bytes, and damaged bytes are refused."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import CodecError
from services.corba.cdr import CdrReader, CdrWriter
from services.corba.typecodes import AnyReader, TypeCode, write_any

_LONG, _DOUBLE, _TEXT = TypeCode("longlong"), TypeCode("double"), TypeCode("string")
_TIME = TypeCode("struct", "Time", "IDL:Time:1.0", (("microseconds", _LONG),))
_VECTOR = TypeCode(
    "struct", "Vector3", "IDL:V:1.0", (("data", TypeCode("array", element=_DOUBLE, length=3)),)
)
_MODE = TypeCode("enum", "Mode", "IDL:Mode:1.0", labels=("GREY", "COLOUR"))
_SAMPLE = TypeCode(
    "struct",
    "Sample",
    "IDL:Sample:1.0",
    (
        ("time", _TIME),
        ("name", _TEXT),
        ("flag", TypeCode("boolean")),
        ("points", TypeCode("sequence", element=_VECTOR)),
        ("names", TypeCode("sequence", element=_TEXT)),
        ("mode", _MODE),
        ("image", TypeCode("sequence", element=TypeCode("octet"))),
    ),
)
_VALUE = {
    "time": {"microseconds": -5},
    "name": "é",
    "flag": True,
    "points": [{"data": [1.0, 2.0, 3.0]}, {"data": [4.0, 5.0, 6.0]}],
    "names": ["a", ""],
    "mode": "COLOUR",
    "image": [1, 2, 255],
}


def _encoded(offset: int = 0) -> bytes:
    writer = CdrWriter(bytes(offset))
    write_any(writer, _SAMPLE, _VALUE)
    return bytes(writer.data)


@pytest.mark.parametrize("offset", [0, 3, 12])
def test_a_value_is_equal_after_its_bytes_at_any_alignment(offset: int) -> None:
    reader, anys = CdrReader(_encoded(offset), True, offset), AnyReader()
    kind, value = anys.read(reader)
    assert kind == _SAMPLE
    assert reader.remaining == 0
    np.testing.assert_array_equal(value["points"]["data"], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    np.testing.assert_array_equal(value["image"], [1, 2, 255])
    rest = {name: item for name, item in value.items() if name not in ("points", "image")}
    assert rest == {name: item for name, item in _VALUE.items() if name not in ("points", "image")}
    again, _ = anys.read(CdrReader(_encoded(offset), True, offset))
    assert again is kind  # types are decoded once


def test_damaged_values_are_refused_or_decoded_in_bounded_memory(rng: np.random.Generator) -> None:
    data = _encoded()
    refused = 0
    for _ in range(10_000):
        damaged = bytearray(data)
        for _ in range(rng.integers(1, 5)):
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        if rng.random() < 0.3:
            damaged = damaged[: rng.integers(len(damaged))]
        try:
            AnyReader().read(CdrReader(bytes(damaged), bool(rng.integers(2))))
        except CodecError:
            refused += 1
    assert refused > 1000


def test_a_type_that_contains_itself_and_a_deep_type_are_refused() -> None:
    writer = CdrWriter()
    writer.number("ulong", 19)
    body = CdrWriter(b"\1")
    body.number("ulong", 0xFFFFFFFF)
    body.number("long", -12 - len(writer.data) + 8)
    body.number("ulong", 0)
    writer.encapsulation(body)
    with pytest.raises(CodecError, match="refers to byte"):
        AnyReader().read(CdrReader(bytes(writer.data), True))
    kind = TypeCode("long")
    for _ in range(40):
        kind = TypeCode("sequence", element=kind)
    deep = CdrWriter()
    write_any(deep, kind, [])
    with pytest.raises(CodecError, match="nesting"):
        AnyReader().read(CdrReader(bytes(deep.data), True))


def test_a_value_of_another_type_is_not_written() -> None:
    for value, text in (
        ({**_VALUE, "mode": "RED"}, "RED"),
        ({"time": 1}, "expected"),
        ({**_VALUE, "time": {}}, "Time"),
        ({**_VALUE, "name": 3}, "as string"),
        ({**_VALUE, "points": {"data": [1.0, 2.0, 3.0]}}, "expected a list or an array"),
        ({**_VALUE, "points": [{"data": {"x": 1.0}}]}, "expected a list or an array"),
        ({**_VALUE, "points": [{"data": ["x", "y", "z"]}]}, "elements as float64"),
        ({**_VALUE, "points": [{"data": np.eye(3)}]}, "expected one dimension"),
        ({**_VALUE, "points": np.zeros(2, [("other", "<f8", (3,))])}, "as Vector3"),
        ({**_VALUE, "image": [256]}, "elements as uint8"),
    ):
        with pytest.raises(CodecError, match=text):
            write_any(CdrWriter(), _SAMPLE, value)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_structured_array_has_the_bytes_of_its_elements(order: str) -> None:
    points = np.zeros(2, [("data", f"{order}f8", (3,))])
    points["data"] = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    writer = CdrWriter()
    write_any(writer, _SAMPLE, {**_VALUE, "points": points})
    assert bytes(writer.data) == _encoded()
