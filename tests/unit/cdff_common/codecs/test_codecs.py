# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``encode`` and ``decode``: names of types, encoding strings, BER, XER and MessagePack."""

from __future__ import annotations

import msgpack
import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import decode, encode, encoding_string, parse_encoding
from cdff_common.codecs.dict_form import from_dict_form, to_dict_form
from cdff_common.errors import CodecError


def test_types_are_found_by_asn1_class_and_infuse_names() -> None:
    data = encode(types.FrameMetadataT())
    for name in ("Frame-metadata-t", "FrameMetadataT", "asn1SccFrame_metadata_t"):
        assert decode(name, data) == types.FrameMetadataT()


@pytest.mark.parametrize("codec", ["json", "", "UPER"])
def test_unknown_codecs_are_refused(codec: str) -> None:
    with pytest.raises(CodecError, match="uper, ber, xer, msgpack"):
        encode(types.Time(), codec)
    with pytest.raises(CodecError, match="uper, ber, xer, msgpack"):
        decode("Time", b"", codec)


def test_invalid_messages_are_refused() -> None:
    with pytest.raises(CodecError, match="dict"):
        encode({}, "uper")
    with pytest.raises(CodecError, match="Pointclod"):
        decode("Pointclod", b"", "uper")


def test_encoding_strings_have_the_documented_form() -> None:
    assert encoding_string("Pointcloud", "uper") == "application/vnd.cdff+uper;Pointcloud/1"
    assert parse_encoding("application/vnd.cdff+msgpack;Frame-metadata-t/1") == (
        "Frame-metadata-t",
        "msgpack",
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "application/json",
        "application/vnd.cdff+uper;Pointcloud/2",
        "application/vnd.cdff+zip;Pointcloud/1",
        "application/vnd.cdff+uper;Pointcloud",
        "application/vnd.cdff+uper;../x/1",
        "application/vnd.cdff+uper;Time/1\n",
    ],
)
def test_other_encoding_strings_are_refused(text: str) -> None:
    with pytest.raises(CodecError):
        parse_encoding(text)


def test_messagepack_has_the_plain_form_of_the_papers_figure_4() -> None:
    state = types.RigidBodyState(types.Time(7), "A", "B", [1, 2, 3])
    plain = msgpack.unpackb(encode(state, "msgpack"))
    assert plain["sourceFrame"] == "A"
    assert plain["timestamp"] == {"microseconds": 7, "usecPerSec": 1000000}
    assert plain["pos"] == [1.0, 2.0, 3.0]
    assert np.isnan(plain["cov_position"]).all()
    frame = types.Frame.from_image(np.zeros((2, 3), np.uint8), stamp_ns=0)
    assert to_dict_form(frame)["data"]["depth"] == "depth_8U"
    assert to_dict_form(frame)["metadata"]["mode"] == "mode_GRAY"


def test_deviations_of_infuse_messages_are_read_and_reported() -> None:
    reports: list[str] = []
    value = from_dict_form("IMUSensors", {"ref_time": {"microseconds": 5}, "acc": [1, 2, 3]}, reports.append)
    assert value.timestamp == types.Time(5)
    assert any("ref_time read as timestamp" in t for t in reports)
    assert any("usecPerSec: missing" in t for t in reports)
    assert any("gyro: missing" in t for t in reports)
    frame = from_dict_form(
        "Frame",
        {"data": {"rows": 1, "cols": 2, "channels": 1, "depth": 0, "row_size": 2, "data": [7, 8]}},
        reports.append,
    )
    assert frame.image.tolist() == [[7, 8]]
    assert any("list of numbers for bytes" in t for t in reports)


@pytest.mark.parametrize(
    ("type_name", "obj", "reason"),
    [
        ("Time", {"microsecs": 3}, "unknown field 'microsecs'"),
        ("Time", [1, 2], "expected a map"),
        ("Time", {"microseconds": "3"}, "Time.microseconds='3'"),
        ("Pose", {"pos": [1, 2]}, r"Pose.pos: shape \(2,\), expected \(3\)"),
        ("Pose", {"pos": ["1", "2", "3"]}, "Pose.pos: expected nested lists of numbers"),
        ("Pose", {"pos": [[1], [2, 3]]}, "Pose.pos"),
        ("Array3D", {"depth": "depth_9U"}, "depth='depth_9U': expected one of depth_8U"),
        ("Array3D", {"data": [1, 300]}, "Array3D.data"),
        ("PosesSequence", {"pos": []}, "expected a list"),
        ("PosesSequence", [{"pos": [0, 0, 0], "orient": [0, 0, 0]}], r"Pose.orient: shape \(3,\)"),
        ("VisualPointFeature3D", {"point": {"nowhere": 1}}, "expected a map of one of position, reference"),
    ],
)
def test_a_plain_form_of_wrong_structure_is_refused_by_field(
    type_name: str, obj: object, reason: str
) -> None:
    with pytest.raises(CodecError, match=reason):
        from_dict_form(type_name, obj)


def test_messagepack_with_a_huge_declared_length_is_refused() -> None:
    for data in (
        b"\xdd\x3b\x9a\xca\x00",
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\x7f\xff\xff\xff",
        b"\x81" * 5000,
        b"",
    ):
        with pytest.raises(CodecError):
            decode("Time", data, "msgpack")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.1, "0.1"),
        (-0.0, "-0"),
        (0.0, "0"),
        (1e-7, "1E-7"),
        (1.5e300, "1.5E300"),
        (5e-324, "5E-324"),
        (float("nan"), "<NOT-A-NUMBER/>"),
        (float("inf"), "<PLUS-INFINITY/>"),
        (float("-inf"), "<MINUS-INFINITY/>"),
        (1e22, "1E22"),
        (123456.789, "123456.789"),
    ],
)
def test_xer_prints_and_reads_reals_by_the_standard(value: float, text: str) -> None:
    message = types.Temperature(value)
    assert encode(message, "xer") == f"<Temperature><kelvin>{text}</kelvin></Temperature>".encode()
    decoded = decode("Temperature", encode(message, "xer"), "xer").kelvin
    np.testing.assert_array_equal(np.float64(decoded).view(np.int64), np.float64(value).view(np.int64))


def test_xer_with_spaces_and_line_ends_is_read() -> None:
    data = b"<?xml version='1.0'?>\n<Time>\n  <microseconds> 5 </microseconds>\n <usecPerSec>7</usecPerSec></Time>\n"
    assert decode("Time", data, "xer") == types.Time(5, 7)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"<Time/>",
        b"<Pose></Pose>",
        b"<Time><microseconds>5</microseconds></Time>",
        b"<Time><microseconds>5.0</microseconds><usecPerSec>1</usecPerSec></Time>",
        b'<!DOCTYPE x [<!ENTITY a "b">]><Time/>',
        b"<a>" * 10000,
        b"<Time><microseconds>99999999999999999999</microseconds><usecPerSec>1</usecPerSec></Time>",
    ],
)
def test_xer_of_wrong_structure_is_refused(data: bytes) -> None:
    with pytest.raises(CodecError):
        decode("Time", data, "xer")


def test_ber_has_the_bytes_of_asn1tools() -> None:
    assert encode(types.Temperature(1.0), "ber").hex() == "3005" + "8003800001"
