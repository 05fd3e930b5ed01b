# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Headers of products, their ids and attachments."""

import uuid

import msgpack
import pytest

from cdff_common.errors import CodecError, InputError
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status, product_id, worst


def header(**changes: object) -> Header:
    fields: dict[str, object] = {
        "id": product_id("mana", "vo", "pose", 2000, 3, "ab"),
        "seq": 3,
        "t0_ns": 1000,
        "t1_ns": 2000,
        "frame": "mana/vo",
        "child": "mana/navcam_left",
        "producer": "vo/Klt/1",
        "config_hash": "ab",
        "inputs": (str(uuid.UUID(int=1)),),
        "quality": Quality(Status.DEGRADED, ("few_inliers:12<30",), CovarianceKind.FORMAL, {"inliers": 12}),
        "box_m": (0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
        "resolution_m": 0.05,
    }
    return Header(**{**fields, **changes})  # type: ignore[arg-type]


def test_a_header_survives_conversion_to_an_attachment() -> None:
    assert Header.from_attachment(header().to_attachment()) == header()


def test_a_retry_has_the_same_id_and_another_configuration_a_different_one() -> None:
    assert product_id("mana", "vo", "pose", 1000, 0, "a") == product_id("mana", "vo", "pose", 1000, 0, "a")
    assert product_id("mana", "vo", "pose", 1000, 0, "a") != product_id("mana", "vo", "pose", 1000, 0, "b")


def test_the_attachment_has_the_fields_of_the_contract() -> None:
    fields = msgpack.unpackb(header().to_attachment())
    assert {
        "v",
        "id",
        "seq",
        "t0_ns",
        "t1_ns",
        "frame",
        "child",
        "producer",
        "config_hash",
        "inputs",
        "quality",
    } <= set(fields)
    assert fields["quality"]["covariance_kind"] == "formal"


@pytest.mark.parametrize(
    "changes",
    [{"t0_ns": 1001}, {"t0_ns": 3000}, {"frame": "Mana"}, {"child": "a b"}],
)
def test_a_header_with_a_wrong_field_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(InputError):
        header(**changes)


@pytest.mark.parametrize(
    "data", [b"", b"\xff\xff", msgpack.packb([1]), msgpack.packb({"v": 2}), msgpack.packb({"v": 1})]
)
def test_invalid_header_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(InputError):
        Header.from_attachment(data)


def test_an_oversized_attachment_is_refused_before_it_is_unpacked() -> None:
    with pytest.raises(CodecError, match="at most"):
        Header.from_attachment(b"\x80" * (2 << 20))


def test_the_worst_status_wins() -> None:
    assert worst(Status.OK, Status.FAILED, Status.DEGRADED) is Status.FAILED
    assert worst() is Status.OK
