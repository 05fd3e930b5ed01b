# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decoding of messages on input keys to samples of ports."""

from __future__ import annotations

import pytest

from cdff_common.bus import Message
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CodecError
from cdff_common.interfaces.product import Header
from cdff_common.types import Correspondence2D, CorrespondenceMap2D
from services.dfpc_host.inputs import decode_sample

_HEADER = Header(
    id="00000000-0000-5000-8000-000000000001", seq=3, t0_ns=0, t1_ns=1000, frame="site", producer="test"
)


def _message(count: int, type_name: str) -> tuple[Message, CorrespondenceMap2D]:
    value = CorrespondenceMap2D((Correspondence2D(),) * count)
    payload = encode(value, "uper", type_name)
    return Message("cdff/k", payload, encoding_string(type_name, "uper"), _HEADER.to_attachment()), value


@pytest.mark.parametrize(
    ("count", "type_name"),
    [(2, "CorrespondenceMap2D"), (2, "CorrespondenceMap2DLarge"), (1500, "CorrespondenceMap2DLarge")],
)
def test_a_port_accepts_its_type_and_the_larger_size_variant(count: int, type_name: str) -> None:
    message, value = _message(count, type_name)
    sample = decode_sample(message, "matches", "CorrespondenceMap2D")
    assert sample.value == value
    assert (sample.stamp_ns, sample.seq) == (1000, 3)


def test_a_message_of_another_type_is_refused_with_both_type_names() -> None:
    message, _ = _message(1, "CorrespondenceMap2D")
    with pytest.raises(CodecError, match="carries CorrespondenceMap2D, port matches takes Pointcloud"):
        decode_sample(message, "matches", "Pointcloud")
