# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every type in every codec: round trips, agreement with asn1tools, and malformed bytes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cdff_common.codecs import CODECS, decode, encode, reference, sizes, uper
from cdff_common.codecs.dict_form import from_dict_form, to_dict_form
from cdff_common.errors import CodecError
from tests.support.messages import ALL, random_message


@pytest.mark.req("CDFF-CORE-051", "CDFF-CORE-052")
@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("name", ALL)
def test_random_messages_survive_a_round_trip(name: str, codec: str, rng: np.random.Generator) -> None:
    for _ in range(3):
        value = random_message(name, rng)
        assert decode(name, encode(value, codec, name), codec) == value


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_uper_messages_are_interchangeable_with_those_of_asn1tools(
    name: str, rng: np.random.Generator
) -> None:
    for _ in range(3):
        value = random_message(name, rng)
        assert reference.decode(name, uper.encode(value, name), "uper") == value
        assert uper.decode(name, reference.encode(value, "uper", name)) == value


@pytest.mark.parametrize("name", ALL)
def test_the_dict_form_contains_builtin_types_only_and_survives_a_round_trip(
    name: str, rng: np.random.Generator
) -> None:
    def check_builtin_types(obj: object) -> None:
        assert type(obj) in (dict, list, str, bytes, int, float, bool)
        for item in obj.values() if isinstance(obj, dict) else obj if isinstance(obj, list) else ():
            check_builtin_types(item)

    value = random_message(name, rng)
    check_builtin_types(to_dict_form(value))
    assert from_dict_form(name, to_dict_form(value)) == value


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(ALL),
    codec=st.sampled_from(CODECS),
    seed=st.integers(0, 2**32 - 1),
    replacements=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=6),
    length=st.integers(0, 10**6),
)
def test_mutated_messages_are_decoded_or_refused(
    name: str, codec: str, seed: int, replacements: list[tuple[int, int]], length: int
) -> None:
    data = bytearray(encode(random_message(name, np.random.default_rng(seed)), codec, name))
    for index, value in replacements:
        data[index % len(data)] = value
    if length % 3 == 0:  # one example in three is also truncated
        data = data[: 1 + length % len(data)]
    try:
        decode(name, bytes(data), codec)
    except CodecError:
        return


@settings(max_examples=200, deadline=None)
@given(name=st.sampled_from(ALL), codec=st.sampled_from(CODECS), data=st.binary(max_size=200))
def test_random_bytes_are_decoded_or_refused(name: str, codec: str, data: bytes) -> None:
    try:
        decode(name, data, codec)
    except CodecError:
        return


@pytest.mark.parametrize("name", ALL)
def test_encoded_sizes_lie_within_the_computed_bounds(name: str, rng: np.random.Generator) -> None:
    min_bytes, max_bytes = sizes.uper_bytes(name)
    for _ in range(3):
        assert min_bytes <= len(encode(random_message(name, rng), "uper", name)) <= max_bytes
