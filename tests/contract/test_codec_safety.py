# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decoders with malformed messages and false lengths: no crash, no endless loop, bounded memory."""

from __future__ import annotations

import tracemalloc

import pytest

from cdff_common.codecs import CODECS, decode, encode
from cdff_common.codecs.wire_types import message_node
from cdff_common.errors import CodecError
from cdff_common.types.validation import class_of
from tests.fuzz_codecs import fuzz
from tests.support.messages import ALL

#: Messages that declare a huge length in one of the encodings, at the start or after a possible header.
_HUGE_LENGTHS = [
    b"\xc4" * 20,
    b"\xff" * 20,
    b"\xdd\x3b\x9a\xca\x00" + b"\x00" * 15,
    b"\xdf\x3b\x9a\xca\x00" + b"\xa1a" * 7,
    b"\xc6\x3b\x9a\xca\x00" + b"\x00" * 15,
    b"\x30\x84\x3b\x9a\xca\x00" + b"\xa0\x84\x3b\x9a\xca\x00" + b"\x00" * 8,
    b"\x30\x80" * 10,
    b"\x91" * 20,
    b"\x81\xa4data\xdd\x3b\x9a\xca\x00" + b"\x00" * 10,
    b"\x81\xa6points\xdc\xff\xff" + b"\x93" * 9,
]
_MAX_ALLOCATION_BYTES = 2_000_000


@pytest.mark.req("CDFF-CORE-053")
@pytest.mark.parametrize("codec", CODECS)
def test_a_short_message_with_a_huge_declared_length_allocates_little(codec: str) -> None:
    for name in ALL:
        # The first call allocates memory that later calls reuse.
        decode(name, encode(class_of(message_node(name).class_name)(), codec, name), codec)
    for name in ALL:
        for message in _HUGE_LENGTHS:
            tracemalloc.start()
            try:
                decode(name, message, codec)
            except CodecError:
                pass
            finally:
                peak = tracemalloc.get_traced_memory()[1]
                tracemalloc.stop()
            assert peak < _MAX_ALLOCATION_BYTES, (name, codec, message)


@pytest.mark.slow
@pytest.mark.req("CDFF-CORE-053")
def test_thousands_of_mutated_messages_are_decoded_or_refused() -> None:
    report = fuzz(6_000, seed=1)
    assert report.findings == []
    assert min(report.decoded, report.refused) > 100


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "cpu_s", [pytest.param(4.0, marks=pytest.mark.slow), pytest.param(60.0, marks=pytest.mark.soak)]
)
def test_mutated_messages_of_all_codecs_are_decoded_or_refused(cpu_s: float) -> None:
    report = fuzz(10_000_000, seed=2, cpu_s=cpu_s)
    assert report.findings == []
    assert set(report.by_codec) == set(CODECS)
