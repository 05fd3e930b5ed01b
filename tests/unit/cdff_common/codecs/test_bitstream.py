# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The bitstream message decodes all its methods, and what robots of InFuse wrote into it."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import CODECS, encode
from cdff_common.codecs.bitstream import METHODS, unwrap, wrap
from cdff_common.errors import CodecError


@pytest.mark.parametrize("codec", METHODS)
def test_a_message_comes_back(codec: str) -> None:
    value = types.Pose([1, 2, 3])
    assert unwrap(wrap(value, codec)) == value


def test_every_codec_has_a_number() -> None:
    assert set(METHODS) == set(CODECS)


def test_prefixed_names_and_padding_are_read() -> None:
    data = np.frombuffer(encode(types.TransformWithCovariance()).ljust(1360, b"\0"), np.uint8)
    bitstream = types.Asn1Bitstream("asn1SccTransformWithCovariance", 0, data)
    assert unwrap(bitstream) == types.TransformWithCovariance()


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(CodecError, match="serialization_method=4: expected 0 uper, 1 ber, 2 xer, 3 msgpack"):
        unwrap(types.Asn1Bitstream("Time", 4))
