# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tests that run for every message type."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import cdff_common.types as types
from cdff_common.codecs import decode, encode
from cdff_common.errors import CodecError
from cdff_common.types import schema_table

#: Message classes, without the ASN.1 CHOICE types, which are sent only as a field of another type.
MESSAGES = [
    c for n in types.__all__ if getattr(c := getattr(types, n), "ASN1_NAME", "") in schema_table.MESSAGES
]


def _assert_equal(a: Any, b: Any) -> None:
    if dataclasses.is_dataclass(a):
        assert type(a) is type(b)
        for field in dataclasses.fields(a):
            _assert_equal(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            _assert_equal(x, y)
    else:
        np.testing.assert_equal(a, b)


@pytest.mark.req("CDFF-CORE-050", "CDFF-CORE-051")
@pytest.mark.parametrize("codec", ["uper", "msgpack"])
@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.__name__)
def test_the_default_value_survives_encoding_and_decoding(message: Any, codec: str) -> None:
    value = message()
    _assert_equal(value, decode(message.ASN1_NAME, encode(value, codec), codec))


@pytest.mark.req("CDFF-CORE-053")
@pytest.mark.parametrize("codec", ["uper", "msgpack"])
@pytest.mark.parametrize(
    "message", [m for m in MESSAGES if m.__name__ in ("Pointcloud", "Frame", "TransformWithCovariance")]
)
def test_truncated_bytes_are_refused_with_the_name_of_the_type(message: Any, codec: str) -> None:
    data = encode(message(), codec)
    with pytest.raises(CodecError, match=message.ASN1_NAME):
        decode(message.ASN1_NAME, data[: len(data) // 2], codec)


@pytest.mark.req("CDFF-CORE-013")
@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.__name__)
def test_arrays_are_contiguous_and_read_only(message: Any) -> None:
    value = message()
    for field in dataclasses.fields(value):
        array = getattr(value, field.name)
        if isinstance(array, np.ndarray):
            assert array.flags.c_contiguous
            assert not array.flags.writeable


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.__name__)
def test_fields_cannot_be_assigned(message: Any) -> None:
    value = message()
    field = dataclasses.fields(value)[0].name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(value, field, getattr(value, field))
