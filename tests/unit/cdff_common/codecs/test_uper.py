# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""UPER: limits of numbers, fragments, bit offsets, padding, and declared lengths beyond the message."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import bits, decode, encode, reference, uper
from cdff_common.codecs.bits import BitReader, BitWriter
from cdff_common.codecs.real import decode_real
from cdff_common.errors import CodecError
from tests.support.messages import REALS


def _bits(values: Any) -> np.ndarray:
    return np.asarray(values, dtype=np.float64).view(np.int64)


@pytest.mark.parametrize("shift", range(8))
def test_reals_survive_bit_for_bit_at_every_offset(shift: int, rng: np.random.Generator) -> None:
    random = rng.integers(0, 2**64, 4000, dtype=np.uint64).view(np.float64)
    values = np.concatenate(
        [REALS, random[~np.isnan(random)], rng.normal(size=200), 2.0 ** np.arange(-1074, 1024)]
    )
    writer = BitWriter()
    writer.put(0, shift)
    writer.put_reals(values)
    writer.put(5, 3)
    reader = BitReader(writer.to_bytes())
    reader.get(shift)
    np.testing.assert_array_equal(_bits(reader.get_reals(len(values))), _bits(values))
    assert reader.get(3) == 5


def test_asn1tools_reads_the_reals_of_cdff_and_vice_versa(rng: np.random.Generator) -> None:
    from asn1tools.codecs.ber import decode_real as asn1tools_decode_real
    from asn1tools.codecs.ber import encode_real as asn1tools_encode_real

    for value in [*REALS, *rng.normal(size=300), *rng.normal(size=50).astype(np.float32)]:
        writer = BitWriter()
        writer.put_reals(np.array([float(value)]))
        octets = writer.to_bytes()
        ours = octets[1 : 1 + octets[0]]
        assert _bits(asn1tools_decode_real(ours)) == _bits(float(value))
        theirs = bytes(asn1tools_encode_real(float(value)))
        assert len(ours) <= len(theirs) or value == 0.0
        assert decode_real(theirs) == value or np.isnan(value)


def test_python_and_compiled_code_agree(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    octets = rng.integers(0, 256, 300, dtype=np.uint8)
    values = np.array([*REALS, *rng.normal(size=30), *(2.0 ** np.arange(-1074, 1024, 41))])

    def write() -> bytes:
        writer = BitWriter()
        for shift in range(9):
            writer.put(0, shift)
            writer.put_reals(values)
            writer.put_bytes(octets)
        return writer.to_bytes()

    def read(data: bytes) -> None:
        reader = BitReader(data)
        for shift in range(9):
            reader.get(shift)
            np.testing.assert_array_equal(_bits(reader.get_reals(len(values))), _bits(values))
            np.testing.assert_array_equal(reader.get_byte_array(len(octets)), octets)

    bits._kernels(is_short=False)
    compiled = write()
    read(compiled)
    monkeypatch.setattr(bits, "_kernels", lambda is_short: None)
    assert write() == compiled
    read(compiled)


def test_short_messages_need_no_compiled_code() -> None:
    code = """
import sys
from cdff_common.codecs import decode, encode
from cdff_common.types import RigidBodyState, TransformWithCovariance
for value in (TransformWithCovariance(), RigidBodyState()):
    for codec in ("uper", "msgpack", "xer"):
        assert decode(value.ASN1_NAME, encode(value, codec), codec) == value
print("numba" in sys.modules)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"


def test_nan_loses_only_its_sign_and_payload() -> None:
    nan = np.array([0xFFF8DEADBEEF0000], dtype=np.uint64).view(np.float64)
    value = types.DoubleSequence(nan)
    decoded = decode("DoubleSequence", encode(value))
    assert np.isnan(decoded.values[0])
    assert decoded == value


@pytest.mark.parametrize(
    "size", [0, 1, 127, 128, 16383, 16384, 16385, 65535, 65536, 65537, 81920, 131072, 200001]
)
def test_fragments_agree_with_asn1tools(size: int) -> None:
    cloud = types.Pointcloud.from_points(
        np.zeros((size, 3)), frame="mana/lidar", stamp_ns=0, intensity=np.arange(size) - 1000
    )
    data = encode(cloud)
    assert decode("Pointcloud", data) == cloud
    bitstream = types.Asn1Bitstream("Pointcloud", 0, (np.arange(size) % 251).astype(np.uint8))
    ours = encode(bitstream)
    assert ours == reference.encode(bitstream, "uper")
    assert decode("Asn1Bitstream", ours) == bitstream
    if size <= 16385:
        assert data == reference.encode(cloud, "uper")


def test_integers_are_encoded_up_to_their_limits() -> None:
    time = types.Time(-(2**63) + 1, -(2**31))
    assert decode("Time", encode(time)) == time
    assert encode(time) == reference.encode(time, "uper")
    cloud = types.Pointcloud.from_points(
        np.zeros((3, 3)), frame="a", stamp_ns=0, intensity=[-(2**31), 0, 2**31 - 1]
    )
    assert encode(cloud) == reference.encode(cloud, "uper")


def test_padding_of_asn1scc_is_read_and_other_trailing_data_refused() -> None:
    data = encode(types.TransformWithCovariance())
    assert decode("TransformWithCovariance", data.ljust(1360, b"\0")) == types.TransformWithCovariance()
    with pytest.raises(CodecError, match="nonzero bits behind"):
        decode("TransformWithCovariance", data + b"\0\1")


def test_mantissas_with_trailing_zeros_as_asn1scc_writes_them_are_read() -> None:
    # One coordinate of a real rover's message, as encoded by asn1scc and by asn1tools.
    theirs, ours = bytes.fromhex("c0cf18902d900d8000"), bytes.fromhex("c0de31205b201b")
    assert decode_real(theirs) == decode_real(ours)
    writer = BitWriter()
    for contents in (theirs, ours):
        writer.put(len(contents), 8)
        writer.put_bytes(contents)
    first, second = BitReader(writer.to_bytes()).get_reals(2)
    assert first == second == pytest.approx(-12.281598, abs=1e-6)


@pytest.mark.parametrize(
    ("contents", "value"),
    [
        ("8000ff", 255.0),  # mantissa only
        ("800400000001", 16.0),  # leading zeros
        ("8801", None),  # no mantissa
        ("840101", 4.0),  # scale factor 1: 1 * 2^1 * 2^1
        ("900103", 24.0),  # base 8
        ("a00103", 48.0),  # base 16
        ("8305000000000105", None),  # exponent of five octets
        ("83010105", 10.0),  # exponent with its own length
        ("82000001" + "05", 10.0),  # exponent of three octets
        ("c000" + "20000000000001" + "00", -float(0x2000000000000100)),  # 62 bits, trailing zeros
        ("8000" + "ffffffffffffffffff", float(0xFFFFFFFFFFFFFFFFFF)),  # mantissa of nine octets: rounded
        ("0331352e45" + "2d31", 1.5),  # decimal 15.E-1
        ("0320312c35452b30", 1.5),  # decimal with a comma
        ("b00001", None),  # reserved base
        ("44", None),  # reserved special value
        ("817fff01", None),  # 2^32767
        ("818000" + "01", 0.0),  # 2^-32768
    ],
)
def test_each_encoding_of_a_real_is_read_or_refused(contents: str, value: float | None) -> None:
    octets = bytes.fromhex(contents)
    writer = BitWriter()
    writer.put(len(octets), 8)
    writer.put_bytes(octets)
    if value is None:
        with pytest.raises(CodecError):
            BitReader(writer.to_bytes()).get_reals(1)
    else:
        assert BitReader(writer.to_bytes()).get_reals(1)[0] == value


def test_denormals_are_rounded_once() -> None:
    # 0x18000000000003 * 2^-1100 is between two denormals.
    octets = bytes.fromhex("81fbb4" + "18000000000003")
    writer = BitWriter()
    writer.put(len(octets), 8)
    writer.put_bytes(octets)
    assert BitReader(writer.to_bytes()).get_reals(1)[0] == decode_real(octets) == 0x18000000000003 / 2**1100


def test_a_small_message_with_a_huge_declared_length_is_refused_before_allocating() -> None:
    bitstream = BitWriter()
    for value, width in ((0, 9), (0, 32), (0xC4, 8), (0, 64)):
        bitstream.put(value, width)
    messages = {
        "PointSequence": b"\xc4" + bytes(19),
        "Asn1Bitstream": bitstream.to_bytes(),
        "VectorXdSequence": b"\xc4" + b"\xff" * 19,
        "CorrespondenceMap3D": b"\xff" * 20,
    }
    for name, data in messages.items():
        tracemalloc.start()
        with pytest.raises(CodecError, match=name):
            decode(name, data)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 1_000_000


def test_a_message_truncated_anywhere_is_refused() -> None:
    data = encode(types.RigidBodyState(source_frame="a", target_frame="b"))
    for size in range(len(data) - 1):
        with pytest.raises(CodecError, match="RigidBodyState as uper"):
            decode("RigidBodyState", data[:size])


def test_an_error_names_the_field() -> None:
    data = encode(types.TransformWithCovariance())
    with pytest.raises(CodecError, match=r"data: cov: "):
        decode("TransformWithCovariance", data[:-5])


def test_numbers_outside_their_enumeration_are_refused() -> None:
    with pytest.raises(CodecError, match="type: FrameErrorTypeT number 3: expected below 3"):
        uper.decode("Frame-error-t", b"\xff" * 10)
