# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Long lists in MessagePack: encoded like other libraries encode them, and every valid encoding is read."""

from __future__ import annotations

import struct
from typing import Any

import msgpack
import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import decode, encode
from cdff_common.codecs.dict_form import to_dict_form
from cdff_common.codecs.messagepack import _kernels as kernels
from cdff_common.errors import CodecError
from tests.support.messages import REALS


@pytest.mark.parametrize("size", [0, 1, 127, 128, 129, 3000, 70_000])
def test_long_lists_are_encoded_like_the_plain_form(size: int, rng: np.random.Generator) -> None:
    points = rng.choice([*REALS, *rng.normal(size=50)], (size, 3))
    cloud = types.Pointcloud.from_points(
        points, frame="a", stamp_ns=0, colors=points, intensity=np.arange(size) - 99
    )
    numbers = types.DoubleSequence(points[:, 0])
    track = types.VectorXdSequence([points[:100, 0]] * 3)
    for value in (cloud, numbers, track):
        data = encode(value, "msgpack")
        assert data == msgpack.packb(to_dict_form(value))
        assert decode(value.ASN1_NAME, data, "msgpack") == value


def _cloud(points: Any, **others: Any) -> bytes:
    plain = to_dict_form(types.Pointcloud.from_points(np.zeros((1, 3)), frame="a", stamp_ns=0))
    plain["data"] = {"points": points, "colors": [], "intensity": []} | others
    return bytes(msgpack.packb(plain, use_single_float=others.get("single", False)))


def test_integers_and_single_precision_reals_are_read() -> None:
    row = [1, -1, 200, -200, 70_000, -70_000, 2**40, -(2**40), 0.5, -33, 127, 128, 2**63]
    points = [[a, b, 0.25] for a in row for b in row]
    assert decode("Pointcloud", _cloud(points), "msgpack").points_m.tolist() == [
        [float(x) for x in p] for p in points
    ]
    singles = msgpack.packb({"values": 1.5}, use_single_float=True)
    assert singles[-5:] == b"\xca" + struct.pack(">f", 1.5)
    data = encode(types.DoubleSequence(np.full(2000, 1.5)), "msgpack")
    data = data[:3] + (b"\xca" + struct.pack(">f", 1.5)) * 2000
    assert decode("DoubleSequence", data, "msgpack") == types.DoubleSequence(np.full(2000, 1.5))


def test_octets_encoded_as_a_long_list_are_read() -> None:
    image = (np.arange(10_000) % 256).astype(np.uint8).reshape(100, 100)
    plain = to_dict_form(types.Frame.from_image(image, stamp_ns=0))
    plain["data"]["data"] = image.reshape(-1).tolist()
    assert np.array_equal(decode("Frame", msgpack.packb(plain), "msgpack").image, image)
    plain["data"]["data"][77] = 256
    with pytest.raises(CodecError, match=r"Frame\.data\.data"):
        decode("Frame", msgpack.packb(plain), "msgpack")


@pytest.mark.parametrize(
    ("points", "others", "message"),
    [
        ([[1.0, 2.0]] * 600, {}, r"shape \(600, 2\), expected \(0..16777216, 3\)"),
        ([[1.0, 2.0, "x"]] * 600, {}, "points: expected nested lists"),
        ([1.0] * 1800, {}, r"shape \(1800,\)"),
        ([[1.0, 2.0, 3.0], [1.0]] * 300, {}, "points: expected nested lists"),
        ([[1.0, 2.0, None]] * 600, {}, "points"),
        ([[1.0] * 3] * 600, {"intensity": [2**31] * 600}, "intensity"),
        ([[1.0] * 3] * 600, {"intensity": [0.5] * 600}, "intensity"),
        ([[1.0] * 3] * 600, {"more": 1}, "unknown field 'more'"),
    ],
)
def test_long_lists_of_wrong_type_are_refused(points: Any, others: dict[str, Any], message: str) -> None:
    with pytest.raises(CodecError, match=message):
        decode("Pointcloud", _cloud(points, **others), "msgpack")


def test_a_long_message_truncated_anywhere_is_refused(rng: np.random.Generator) -> None:
    data = encode(types.Pointcloud.from_points(rng.normal(size=(400, 3)), frame="a", stamp_ns=0), "msgpack")
    for size in [*range(4000, len(data), 97), len(data) - 1]:
        with pytest.raises(CodecError):
            decode("Pointcloud", data[:size], "msgpack")
    with pytest.raises(CodecError, match="followed by 1 more"):
        decode("Pointcloud", data + b"\0", "msgpack")


@pytest.mark.parametrize(
    "value",
    [
        None,
        True,
        0,
        127,
        128,
        255,
        256,
        65535,
        65536,
        2**32,
        2**64 - 1,
        -1,
        -32,
        -33,
        -128,
        -129,
        -32769,
        -(2**31) - 1,
        1.5,
        "",
        "x" * 31,
        "x" * 32,
        "x" * 256,
        "x" * 65536,
        b"",
        b"x" * 256,
        b"x" * 65536,
        [],
        [1] * 15,
        [1] * 16,
        [[1]] * 65536,
        {},
        {i: [i] for i in range(15)},
        dict.fromkeys(range(16), "x"),
        dict.fromkeys(range(65536), 0),
        msgpack.ExtType(1, b"x"),
        msgpack.ExtType(1, b"xx"),
        msgpack.ExtType(1, b"x" * 16),
        msgpack.ExtType(1, b"xyz"),
        msgpack.ExtType(1, b"x" * 300),
        msgpack.ExtType(1, b"x" * 70000),
    ],
    ids=lambda v: f"{type(v).__name__}-{len(v) if hasattr(v, '__len__') else v}",
)
def test_any_object_is_skipped_completely_or_reported_as_truncated(value: Any) -> None:
    data = np.frombuffer(msgpack.packb(value), dtype=np.uint8)
    assert kernels.skip(data, 0) == len(data)
    for size in {0, 1, 2, len(data) // 2, len(data) - 1} - {len(data)}:
        assert kernels.skip(data[:size], 0) == kernels.TRUNCATED or size >= len(data)
    ends = np.zeros(2, dtype=np.int64)
    assert kernels.skip_many(np.tile(data, 2), 0, ends) == 2
    assert ends.tolist() == [len(data), 2 * len(data)]
    assert kernels.skip(np.array([0xC1], np.uint8), 0) == kernels.MALFORMED
