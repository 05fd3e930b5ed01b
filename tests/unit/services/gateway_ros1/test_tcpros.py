# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Connection headers and MD5 sums of ROS 1."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdff_common.errors import CodecError
from services.gateway_ros1.tcpros import decode_header, encode_header
from services.gateways.request_types import GET_GRID_MAP, GET_MAP, SERVICES
from services.ros_messages.md5_sums import message_md5, service_md5, wire_name
from services.ros_messages.message_types import BITSTREAM, RosTypes
from services.ros_messages.service_types import ServiceType

_TYPES = RosTypes(1)
_NAMES = st.text(
    st.characters(blacklist_characters="=", blacklist_categories=("Cs",)), min_size=1, max_size=8
)


@given(fields=st.dictionaries(_NAMES, st.text(st.characters(blacklist_categories=("Cs",)), max_size=20)))
def test_a_header_is_equal_after_its_bytes(fields: dict[str, str]) -> None:
    data = encode_header(fields)
    assert int.from_bytes(data[:4], "little") == len(data) - 4
    assert decode_header(data[4:]) == fields


def test_a_header_has_the_bytes_of_the_documentation() -> None:
    """Source: http://wiki.ros.org/ROS/Connection%20Header."""
    data = encode_header({"callerid": "/rostopic_4767_1316912741557", "tcp_nodelay": "1"})
    assert data[:8].hex() == "3a00000025000000"
    assert data[8:45] == b"callerid=/rostopic_4767_1316912741557"
    assert data[45:] == bytes.fromhex("0d000000") + b"tcp_nodelay=1"


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"\x01", "cut off"),
        (b"\xff\xff\xff\xffa=b", "states 4294967295 bytes"),
        (b"\x03\x00\x00\x00abc", "has no ="),
    ],
)
def test_a_malformed_header_is_refused(data: bytes, reason: str) -> None:
    with pytest.raises(CodecError, match=reason):
        decode_header(data)


@pytest.mark.parametrize(
    ("name", "md5"),
    [
        ("sensor_msgs/msg/Imu", "6a62c6daae103f4ff57a132d6f95cec2"),
        ("sensor_msgs/msg/PointCloud2", "1158d486dd51d683ce2f1be655c3c181"),
        ("nav_msgs/msg/OccupancyGrid", "3381f2d731d4076ec5c71b0759edbe4e"),
        ("tf2_msgs/msg/TFMessage", "94810edda583a504dfda3829e70d7eec"),
        ("grid_map_msgs/msg/GridMap", "95681e052b1f73bf87b7eb984382b401"),
        (BITSTREAM, "2bdf6d807f5ec0c1dcac26c88cebc0ac"),
    ],
)
def test_message_types_have_the_sums_of_ros(name: str, md5: str) -> None:
    assert message_md5(_TYPES, name) == md5


@pytest.mark.parametrize(
    ("name", "md5"),
    [(GET_MAP, "6cdd0a18e0aff5b0a3ca2326a89b54ff"), (GET_GRID_MAP, "802c2cbc7b10fada2d44db75ddb8c738")],
)
def test_service_types_have_the_sums_of_ros(name: str, md5: str) -> None:
    service = ServiceType.register(_TYPES, name, SERVICES[name].definition)
    assert service_md5(_TYPES, service.request, service.response) == md5


def test_names_of_types_are_those_of_ros_1() -> None:
    names = [wire_name(n) for n in ("sensor_msgs/msg/Imu", GET_MAP, BITSTREAM)]
    assert names == ["sensor_msgs/Imu", "nav_msgs/GetMap", "infuse_msgs/asn1_bitstream"]
