# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values and images of YARP: examples of its documentation, round trips and damaged bytes."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cdff_common.errors import CodecError
from services.yarp.bottle import Vocab, decode_bottle, encode_bottle, format_text, parse_text
from services.yarp.images import decode_yarp_image, encode_yarp_image

_VALUES = st.recursive(
    st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)
    | st.binary(max_size=8)
    | st.sampled_from(["get", "mat", "a"]).map(Vocab),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=12,
)


def _plain(value: Any) -> Any:
    """A value with lists for arrays."""
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def test_the_examples_of_the_documentation() -> None:
    primes = [2, 3, 5, 7, 11, 13, 17, 19]
    assert encode_bottle(primes) == struct.pack("<10i", 257, 8, *primes)
    assert parse_text("2 3 5 7 11 13 17 19") == primes
    words = ["this", "is", "a", "good list"]
    texts = b"".join(struct.pack("<i", len(word)) + word.encode() for word in words)
    expected = struct.pack("<7i", 256, 2, 257, 3, 91, 92, 93) + struct.pack("<2i", 260, 4) + texts
    assert encode_bottle([[91, 92, 93], words]) == expected
    assert parse_text('(91 92 93) (this is a "good list")') == [[91, 92, 93], words]
    assert Vocab("abcd").number == 1684234849
    assert parse_text("[get] {1 10 255} 10.57 -15") == [Vocab("get"), b"\x01\x0a\xff", 10.57, -15]


@settings(max_examples=200, deadline=None)
@given(values=st.lists(_VALUES, max_size=5))
def test_values_are_equal_after_binary_and_text(values: list[Any]) -> None:
    assert _plain(decode_bottle(encode_bottle(values))) == values
    assert parse_text(format_text(values)) == values


@pytest.mark.parametrize(
    ("mode", "shape", "dtype"), [("GRAY", (3, 5), "u1"), ("GRAY", (2, 3), "<u2"), ("BGR", (4, 3, 3), "u1")]
)
def test_images_are_equal_after_their_bytes(mode: str, shape: tuple[int, ...], dtype: str, rng: Any) -> None:
    image = rng.integers(0, 255, shape).astype(dtype)
    data = encode_yarp_image(image, mode)
    back, back_mode = decode_yarp_image(data)
    assert back_mode == mode
    np.testing.assert_array_equal(back, image)
    with pytest.raises(CodecError, match="expected"):
        decode_yarp_image(data[:-1])


def test_rows_with_padding_are_read() -> None:
    image = np.arange(6, dtype=np.uint8).reshape(2, 3)
    header = bytearray(encode_yarp_image(image, "GRAY")[:60])
    struct.pack_into("<i", header, 36, 16)
    struct.pack_into("<h", header, 40, 8)
    struct.pack_into("<i", header, 56, 16)
    rows = np.pad(image, ((0, 0), (0, 5))).tobytes()
    np.testing.assert_array_equal(decode_yarp_image(bytes(header) + rows)[0], image)


def test_damaged_values_are_refused_or_decoded(rng: np.random.Generator) -> None:
    data = encode_bottle([1, 2.5, "text", b"blob", [Vocab("get"), [1.0, 2.0]], np.arange(5.0)])
    image = encode_yarp_image(np.zeros((4, 5, 3), np.uint8), "RGB")
    refused = 0
    for i in range(10_000):
        whole, decode = ((data, decode_bottle), (image, decode_yarp_image))[i % 2]
        damaged = bytearray(whole)
        for _ in range(rng.integers(1, 5)):
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        if rng.random() < 0.2:
            damaged = damaged[: rng.integers(len(damaged))]
        try:
            decode(bytes(damaged))
        except CodecError:
            refused += 1
    assert refused > 1000


@pytest.mark.parametrize("text", ["(1 2", "1)", "{300}", "{a}", '"open'])
def test_malformed_text_is_refused(text: str) -> None:
    with pytest.raises(CodecError):
        parse_text(text)
