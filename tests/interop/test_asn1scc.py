# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages as asn1scc and LAAS's robots write them: mantissas of 53 bits, counted NULs, padding to the largest size."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import bitstream, decode, encode, reference, sizes
from cdff_common.codecs.bridge import message_node, to_asn1
from cdff_common.codecs.schema import Alias, ListOf, Node, Struct, Text
from tests import messages
from tests.messages import ALL, random_message

#: Sizes that asn1scc allots are REQUIRED_BYTES_FOR_ENCODING; above this they are not worth a test.
_MOST_PADDED = 1_000_000
#: Values that asn1scc's C code can hold: no NaN, no infinities, no -0.
_REALS = [v for v in messages.REALS if math.isfinite(v) and not (v == 0.0 and math.copysign(1.0, v) < 0.0)]


def _encode_real(value: float) -> bytearray:
    """Contents octets of a REAL as asn1scc writes them: all 53 bits of the mantissa, trailing zeros and all."""
    if value == 0.0:
        return bytearray()
    fraction, exponent = math.frexp(abs(value))
    mantissa, exponent = int(fraction * 2.0**53), exponent - 53
    octets = 1 if -128 <= exponent <= 127 else 2
    head = 0x80 | (0x40 if value < 0.0 else 0) | (octets - 1)
    return bytearray([head, *exponent.to_bytes(octets, "big", signed=True), *mantissa.to_bytes(7, "big")])


def _with_nul(obj: Any, node: Node | Alias) -> Any:
    """Every text with the NUL that ends it in C, counted."""
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
    return bytes(specification.encode(node.name, _with_nul(to_asn1(value, node), node)))


@pytest.fixture(autouse=True)
def _asn1scc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(messages, "REALS", _REALS)
    monkeypatch.setattr("asn1tools.codecs.per.encode_real", _encode_real)


def test_our_padded_form_is_that_of_asn1scc() -> None:
    # the value and the two encodings of the reference, from a real rover
    contents = bytes.fromhex("c0cf18902d900d8000")
    value = -float(0x18902D900D8000) * 2.0**-49
    assert _encode_real(value) == contents
    assert sizes.uper_octets("TransformWithCovariance", real_octets=13)[1] == 1360


@pytest.mark.req("CDFF-CORE-051")
@pytest.mark.parametrize("name", ALL)
def test_what_asn1scc_writes_is_read_and_written_again_with_the_same_value(name: str, rng: np.random.Generator) -> None:
    for _ in range(2):
        value = random_message(name, rng)
        data = _as_asn1scc(value, name)
        most = sizes.uper_octets(name, real_octets=13)[1]
        if most <= _MOST_PADDED:
            assert len(data) <= most
            data = data.ljust(most, b"\0")
        read = decode(name, data)
        assert read == value
        assert decode(name, encode(read, "uper", name)) == value


def test_a_padded_bitstream_of_a_robot_is_unwrapped() -> None:
    pose = types.TransformWithCovariance(
        types.TransformWithCovarianceMetadata(parent_frame_id="LocalTerrainFrame", child_frame_id="RoverBodyFrame"),
        types.TransformWithCovarianceData([-12.281598, -28.618572, -0.083111], cov=np.eye(6)),
    )
    data = _as_asn1scc(pose, "TransformWithCovariance").ljust(1360, b"\0")
    message = types.Asn1Bitstream("asn1SccTransformWithCovariance", 0, data)
    assert bitstream.unwrap(message) == pose
