# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keys, tokens and attachments are byte for byte those of other implementations of rmw_zenoh."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from cdff_common.errors import CodecError
from services.gateway_ros2 import rmw_zenoh
from services.ros_messages.type_hashes import message_hash, service_hash

_STRING = "std_msgs/msg/String"
_SET_BOOL = "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a"
#: Token, and the id that ``rmw_zenoh_gid`` of pyzeros 0.1.0 returns for it.
_TOKEN = (
    "@ros2_lv/0/4d60873c/0/2/MP/%/%/pz_node/%from_pz/std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,10:,:,:,,"
)
_GID = "4a388ff8a533c6bbed211a57291693c1"
_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"


def test_the_key_of_a_topic_has_domain_topic_type_and_hash() -> None:
    found_hash = message_hash(get_typestore(Stores.ROS2_JAZZY).fielddefs, _STRING)
    key = rmw_zenoh.data_key(0, "/chatter", _STRING, found_hash)
    assert key == f"0/chatter/std_msgs::msg::dds_::String_/{_HASH}"


def test_tokens_are_those_that_pyzeros_declares() -> None:
    node = rmw_zenoh.Node(0, "4d60873c", "pz_node")
    assert node.token == "@ros2_lv/0/4d60873c/0/0/NN/%/%/pz_node"
    token = node.entity_token(2, "MP", "/from_pz", _STRING, _HASH, rmw_zenoh.QOS_DEFAULT)
    start = "@ros2_lv/0/4d60873c/0/2/MP/%/%/pz_node/%from_pz/std_msgs::msg::dds_::String_"
    assert token == f"{start}/{_HASH}/::,10:,:,:,,"


def test_slashes_of_a_topic_are_percent_signs_in_its_token() -> None:
    token = rmw_zenoh.Node(7, "a", "n").entity_token(
        1, "MS", "/imu/data", _STRING, "*", rmw_zenoh.QOS_SENSOR_DATA
    )
    assert token.split("/")[9] == "%imu%data"


def test_an_attachment_has_33_bytes_with_number_time_and_id() -> None:
    gid = bytes(range(16))
    data = rmw_zenoh.Attachment(0x30, 0x18EA55236B2A92A6, gid).to_bytes()
    assert data.hex() == "3000000000000000" + "a6922a6b2355ea18" + "10" + gid.hex()
    assert rmw_zenoh.Attachment.from_bytes(data) == rmw_zenoh.Attachment(0x30, 0x18EA55236B2A92A6, gid)


@pytest.mark.parametrize("data", [b"", bytes(32), bytes(33), bytes(34)])
def test_other_bytes_are_refused_as_an_attachment(data: bytes) -> None:
    with pytest.raises(CodecError, match="33 bytes"):
        rmw_zenoh.Attachment.from_bytes(data)


@pytest.mark.parametrize(
    ("quality", "text"),
    [
        (rmw_zenoh.QOS_DEFAULT, "::,10:,:,:,,"),
        (rmw_zenoh.QOS_SENSOR_DATA, "2::,5:,:,:,,"),
        (rmw_zenoh.QOS_LATCHED, ":1:,1:,:,:,,"),
        (rmw_zenoh.Quality(keep_all=True), "::2,:,:,:,,"),
        (rmw_zenoh.Quality(deadline_ns=500_000_000), "::,10:0,500000000:,:,,"),
        (rmw_zenoh.Quality(depth=42), "::,:,:,:,,"),
    ],
)
def test_qualities_of_service_have_the_text_of_rmw_zenoh(quality: rmw_zenoh.Quality, text: str) -> None:
    assert str(quality) == text


def test_the_key_of_a_service_is_that_of_other_implementations() -> None:
    found_hash = service_hash(
        get_typestore(Stores.ROS2_KILTED).fielddefs,
        "std_srvs/srv/SetBool",
        "bool data\n---\nbool success\nstring message",
    )
    key = rmw_zenoh.data_key(0, "/arm", "std_srvs/srv/SetBool", found_hash)
    assert key == f"0/arm/std_srvs::srv::dds_::SetBool_/{_SET_BOOL}"


def test_the_id_of_a_publisher_is_the_hash_that_pyzeros_computes() -> None:
    gid = rmw_zenoh.gid_of(_TOKEN)
    assert gid.hex() == _GID
    assert gid != rmw_zenoh.gid_of(f"{_TOKEN},")
