# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages in the form that asn1scc and LAAS's robots write are read.

This form has mantissas of 53 bits, texts that include their final NUL, and padding to the largest size.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import bitstream, decode, encode, reference, sizes
from cdff_common.codecs.dict_form import dict_form_of
from cdff_common.codecs.wire_types import message_node
from cdff_common.types.schema import Alias, ListOf, Node, Struct, Text
from tests.support import messages
from tests.support.messages import ALL, random_message

#: Messages are padded to asn1scc's REQUIRED_BYTES_FOR_ENCODING if that is at most this number of bytes.
_MAX_PADDED_BYTES = 1_000_000
#: Values that asn1scc's C code can hold: no NaN, no infinities, no -0.
_REALS = [v for v in messages.REALS if math.isfinite(v) and not (v == 0.0 and math.copysign(1.0, v) < 0.0)]


def _encode_real(value: float) -> bytearray:
    """Return the contents octets of a REAL as asn1scc writes them: all 53 bits of the mantissa, including
    trailing zeros.
    """
    if value == 0.0:
        return bytearray()
    fraction, exponent = math.frexp(abs(value))
    mantissa, exponent = int(fraction * 2.0**53), exponent - 53
    octets = 1 if -128 <= exponent <= 127 else 2
    head = 0x80 | (0x40 if value < 0.0 else 0) | (octets - 1)
    return bytearray([head, *exponent.to_bytes(octets, "big", signed=True), *mantissa.to_bytes(7, "big")])


def _with_nul(obj: Any, node: Node | Alias) -> Any:
    """Return a message with the final NUL of C appended to each text."""
    match node:
        case Text():
            return (obj + b"\0")[: node.high]
        case Struct():
            return {f.name: _with_nul(obj[f.name], f.node) for f in node.fields}
        case Alias():
            return _with_nul(obj, node.node)
        case ListOf():
            return [_with_nul(item, node.element) for item in obj]
        case _:
            return obj


def _as_asn1scc(value: Any, type_name: str) -> bytes:
    node = message_node(type_name)
    specification = reference._specification("uper")
    return bytes(specification.encode(node.name, _with_nul(dict_form_of(value, node, asn1tools=True), node)))


@pytest.fixture(autouse=True)
def _asn1scc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(messages, "REALS", _REALS)
    monkeypatch.setattr("asn1tools.codecs.per.encode_real", _encode_real)


def test_the_padded_form_equals_that_of_asn1scc() -> None:
    # A value from a message of a real rover, with its encoding there.
    contents = bytes.fromhex("c0cf18902d900d8000")
    value = -float(0x18902D900D8000) * 2.0**-49
    assert _encode_real(value) == contents
    assert sizes.uper_bytes("TransformWithCovariance", real_octets=13)[1] == 1360


@pytest.mark.req("CDFF-CORE-051")
@pytest.mark.parametrize("name", ALL)
def test_a_message_of_asn1scc_survives_a_round_trip(name: str, rng: np.random.Generator) -> None:
    for _ in range(2):
        value = random_message(name, rng)
        data = _as_asn1scc(value, name)
        max_bytes = sizes.uper_bytes(name, real_octets=13)[1]
        if max_bytes <= _MAX_PADDED_BYTES:
            assert len(data) <= max_bytes
            data = data.ljust(max_bytes, b"\0")
        decoded = decode(name, data)
        assert decoded == value
        assert decode(name, encode(decoded, "uper", name)) == value


def test_a_padded_bitstream_of_a_robot_is_unwrapped() -> None:
    pose = types.TransformWithCovariance(
        types.TransformWithCovarianceMetadata(
            parent_frame_id="LocalTerrainFrame", child_frame_id="RoverBodyFrame"
        ),
        types.TransformWithCovarianceData([-12.281598, -28.618572, -0.083111], cov=np.eye(6)),
    )
    data = _as_asn1scc(pose, "TransformWithCovariance").ljust(1360, b"\0")
    message = types.Asn1Bitstream("asn1SccTransformWithCovariance", 0, data)
    assert bitstream.unwrap(message) == pose
