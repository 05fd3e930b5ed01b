# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The client converts a reply into an answer."""

from __future__ import annotations

import pytest

from cdff_common.bus import Reply
from cdff_common.client import Answer
from cdff_common.client.client import _answer, _orchestrator_key
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CodecError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header, Quality, Status, product_id
from cdff_common.types import TransformWithCovariance

HEADER = Header(
    product_id("mana", "d", "p", 0, 0, ""), 0, 0, 0, "site", "d/i/1", quality=Quality(Status.DEGRADED, ("x",))
)
VALUE = TransformWithCovariance.from_transform(
    UncertainTransform.identity(), parent="a", child="b", stamp_ns=0
)


@pytest.mark.parametrize("codec", ["uper", "ber", "xer", "msgpack"])
def test_a_payload_in_any_codec_is_decoded(codec: str) -> None:
    attachment = {
        **HEADER.to_dict(),
        "robot": "mana",
        "job": "j",
        "request": "r",
        "delivered": {"age_s": 1.0},
    }
    encoding = encoding_string("TransformWithCovariance", codec)
    answer = _answer(Reply(encode(VALUE, codec), encoding, attachment))
    assert answer.value == VALUE
    assert answer.header == HEADER
    assert (answer.robot, answer.job, answer.request, answer.delivered) == ("mana", "j", "r", {"age_s": 1.0})
    assert answer.is_degraded
    assert answer.summary()["header"]["quality"]["reasons"] == ["x"]


def test_a_file_is_returned_as_bytes() -> None:
    answer = _answer(Reply(b"II*", "image/tiff", HEADER.to_dict()))
    assert answer.value is None
    assert (answer.data, answer.type_name) == (b"II*", "image/tiff")


def test_an_answer_without_a_header_is_refused() -> None:
    with pytest.raises(CodecError):
        _answer(Reply(b"", "image/tiff", {}))


def test_requests_for_any_robot_use_the_keys_of_the_ground_and_others_the_keys_of_the_robot() -> None:
    assert _orchestrator_key("any", "jobs") == "cdff/@v1/ground/orchestrator/@rpc/jobs"
    assert _orchestrator_key("mana", "jobs") == "cdff/@v1/mana/orchestrator/@rpc/jobs"


def test_the_repr_of_an_answer_is_one_short_line() -> None:
    answer = Answer(None, HEADER, "ElevationMap", bytes(100_000), "application/vnd.cdff+uper", robot="mana")
    assert repr(answer) == (
        "Answer(ElevationMap of mana, 100000 bytes as application/vnd.cdff+uper, DEGRADED)"
    )
    assert "reasons" in answer._repr_html_()
