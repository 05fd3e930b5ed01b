# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bitstream messages: every serialization method, and messages as written by the robots of InFuse."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import CODECS, encode
from cdff_common.codecs.bitstream import METHODS, unwrap, wrap
from cdff_common.errors import CodecError


@pytest.mark.parametrize("codec", METHODS)
def test_a_message_survives_a_round_trip(codec: str) -> None:
    value = types.Pose([1, 2, 3])
    assert unwrap(wrap(value, codec)) == value


def test_every_codec_has_a_method_number() -> None:
    assert set(METHODS) == set(CODECS)


def test_a_message_with_prefixed_type_name_and_padding_is_read() -> None:
    data = np.frombuffer(encode(types.TransformWithCovariance()).ljust(1360, b"\0"), np.uint8)
    bitstream = types.Asn1Bitstream("asn1SccTransformWithCovariance", 0, data)
    assert unwrap(bitstream) == types.TransformWithCovariance()


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(CodecError, match="serialization_method=4: expected 0 uper, 1 ber, 2 xer, 3 msgpack"):
        unwrap(types.Asn1Bitstream("Time", 4))
