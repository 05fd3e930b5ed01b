# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Definitions of types by Typelib are decoded, or refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.pocolog.decoding import decode_sample
from cdff_dev.logs.formats.pocolog.registry import Registry

NUMBERS = (
    '<numeric name="/int32_t" category="sint" size="4"/><numeric name="/double" category="float" size="8"/>'
    '<numeric name="/int8_t" category="sint" size="1"/><alias name="/int" source="/int32_t"/>'
    '<container name="/std/string" of="/int8_t" size="32" kind="/std/string"/>'
)


def registry(nodes: str, order: str = "<") -> Registry:
    return Registry(f'<?xml version="1.0"?><typelib>{NUMBERS}{nodes}</typelib>'.encode(), order)


def compound(name: str, size: int, *fields: tuple[str, str, int]) -> str:
    lines = "".join(f'<field name="{n}" type="{t}" offset="{o}"/>' for n, t, o in fields)
    return f'<compound name="{name}" size="{size}">{lines}</compound>'


@pytest.mark.parametrize("order", ["<", ">"])
def test_arrays_and_aliases_are_decoded_by_dtype(order: str) -> None:
    kind = registry(compound("/A", 24, ("n", "/int", 0), ("v", "/int[2][2]", 4)), order).build("/A")
    value = decode_sample(kind, np.arange(5, dtype=f"{order}i4").tobytes() + bytes(4), order)
    assert value["n"] == 0
    np.testing.assert_array_equal(value["v"], [[1, 2], [3, 4]])


def test_vectors_of_compounds_are_arrays() -> None:
    nodes = compound("/A", 16, ("x", "/double", 0), ("n", "/int", 8))
    nodes += '<container name="/std/vector&lt;/A&gt;" of="/A" size="24" kind="/std/vector"/>'
    kind = registry(nodes).build("/std/vector</A>")
    element = np.dtype({"names": ["x", "n"], "formats": ["<f8", "<i4"], "offsets": [0, 8], "itemsize": 16})
    values = np.zeros(1000, element)
    values["x"] = np.arange(1000)
    decoded = decode_sample(kind, (1000).to_bytes(8, "little") + values.tobytes(), "<")
    assert isinstance(decoded, np.ndarray)
    np.testing.assert_array_equal(decoded["x"], values["x"])


def test_arrays_of_texts_are_lists() -> None:
    kind = registry("").build("/std/string[2]")
    data = b"".join(len(t).to_bytes(8, "little") + t for t in (b"a", b"bc"))
    assert decode_sample(kind, data, "<") == ["a", "bc"]


@pytest.mark.parametrize(
    ("nodes", "name", "expected"),
    [
        ("", "/missing", "expected a definition"),
        ("", "/int*", "a pointer"),
        ("", "/double[999999999]", "999999999 elements"),
        ("", "/double[0]", "0 elements"),
        ('<opaque name="/O" size="8"/>', "/O", "opaque, expected one of"),
        ('<null name="/N"/>', "/N", "null"),
        ('<alias name="/A" source="/A"/>', "/A", "recursive"),
        (compound("/A", 24, ("a", "/A", 0)), "/A", "recursive"),
        ('<container name="/V" of="/V" size="24" kind="/std/vector"/>', "/V", "recursive"),
        ('<container name="/V" of="/int" size="24" kind="/std/map"/>', "/V", "expected /std/vector"),
        ('<numeric name="/F" category="float" size="16"/>', "/F", "float of 16 bytes"),
        (compound("/A", 8, ("a", "/int", 0), ("b", "/int", 2)), "/A", "field b at byte 2"),
        (compound("/A", 4, ("a", "/double", 0)), "/A", "field a at byte 0"),
        (compound("/A", 8, ("a", "/int", 0), ("a", "/int", 4)), "/A", "type /A"),
        (compound("/A", 99999, ("a", "/int", 0)), "/A", "bytes after its fields"),
        ('<compound name="/A" size="x"/>', "/A", "size='x'"),
        ('<enum name="/E"><value symbol="a" value="many"/></enum>', "/E", "type /E"),
    ],
)
def test_types_without_a_defined_encoding_are_refused(nodes: str, name: str, expected: str) -> None:
    with pytest.raises(CodecError, match=r"(type|size).*") as error:
        registry(nodes).build(name)
    assert expected in str(error.value)


@pytest.mark.parametrize(
    "xml",
    [
        b"<typelib>",
        b"\xff\xfe",
        b'<!DOCTYPE x [<!ENTITY a "aaaa">]><typelib>&a;</typelib>',
        b'<?xml version="1.0" encoding="none"?><typelib/>',
    ],
)
def test_definitions_that_are_not_plain_xml_are_refused(xml: bytes) -> None:
    with pytest.raises(CodecError, match="type definitions"):
        Registry(xml, "<")


def test_lengths_beyond_the_sample_are_refused_before_memory_is_used() -> None:
    kind = registry('<container name="/V" of="/int" size="24" kind="/std/vector"/>').build("/V")
    with pytest.raises(CodecError, match="1152921504606846976 elements at byte 0, expected at most 1"):
        decode_sample(kind, (1 << 60).to_bytes(8, "little") + bytes(4), "<")
