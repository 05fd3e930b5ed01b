# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""No message, however broken or boastful, makes a decoder crash, hang, or take memory that it was not given."""

from __future__ import annotations

import tracemalloc

import pytest

from cdff_common.codecs import CODECS, decode, encode
from cdff_common.codecs.bridge import class_of, message_node
from cdff_common.errors import CodecError
from tests.fuzz_codecs import fuzz
from tests.messages import ALL

#: Octets that claim very much in one encoding or another, at the begin or after what a header may be.
_CLAIMS = [
    b"\xc4" * 20, b"\xff" * 20, b"\xdd\x3b\x9a\xca\x00" + b"\x00" * 15, b"\xdf\x3b\x9a\xca\x00" + b"\xa1a" * 7,
    b"\xc6\x3b\x9a\xca\x00" + b"\x00" * 15, b"\x30\x84\x3b\x9a\xca\x00" + b"\xa0\x84\x3b\x9a\xca\x00" + b"\x00" * 8,
    b"\x30\x80" * 10, b"\x91" * 20, b"\x81\xa4data\xdd\x3b\x9a\xca\x00" + b"\x00" * 10,
    b"\x81\xa6points\xdc\xff\xff" + b"\x93" * 9,
]  # fmt: skip
_MOST_BYTES = 2_000_000


@pytest.mark.req("CDFF-CORE-053")
@pytest.mark.parametrize("codec", CODECS)
def test_twenty_octets_that_claim_a_thousand_million_points_cost_nothing(codec: str) -> None:
    for name in ALL:
        decode(name, encode(class_of(message_node(name).class_name)(), codec, name), codec)  # what is made once
    for name in ALL:
        for claim in _CLAIMS:
            tracemalloc.start()
            try:
                decode(name, claim, codec)
            except CodecError:
                pass
            finally:
                peak = tracemalloc.get_traced_memory()[1]
                tracemalloc.stop()
            assert peak < _MOST_BYTES, (name, codec, claim)


@pytest.mark.req("CDFF-CORE-053")
def test_some_thousand_mutated_messages_are_decoded_or_refused() -> None:
    found = fuzz(6_000, seed=1)
    assert found.findings == []
    assert min(found.decoded, found.refused) > 100


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_minute_of_mutated_messages_is_decoded_or_refused() -> None:
    found = fuzz(10_000_000, seed=2, cpu_s=60.0)
    assert found.findings == []
    assert set(found.by_codec) == set(CODECS)
