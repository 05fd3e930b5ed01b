# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Size variants: a class with two ASN.1 types, of which the smaller is used if the message fits."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import CODECS, bitstream, decode, encode
from cdff_common.codecs.wire_types import base_type, wire_type
from cdff_common.errors import CodecError
from cdff_common.types.schema_table import LARGE, MESSAGES
from tests.support.messages import random_message


def _features(count: int) -> types.CorrespondenceMap2D:
    return types.CorrespondenceMap2D((types.Correspondence2D([1.0, 2.0], [3.0, 4.0], 0.5),) * count)


@pytest.mark.parametrize(
    ("count", "name"), [(1024, "CorrespondenceMap2D"), (1025, "CorrespondenceMap2DLarge")]
)
def test_the_smallest_size_variant_that_fits_is_selected(count: int, name: str) -> None:
    value = _features(count)
    assert wire_type(value) == name
    for codec in CODECS:
        decoded = decode(name, encode(value, codec), codec)
        assert type(decoded) is types.CorrespondenceMap2D
        assert decoded == value


@pytest.mark.parametrize("codec", CODECS)
def test_a_small_message_survives_a_round_trip_in_either_size_variant(codec: str) -> None:
    value = _features(3)
    for name in ("CorrespondenceMap2D", "CorrespondenceMap2DLarge"):
        assert decode(name, encode(value, codec, name), codec) == value


def test_a_cloud_larger_than_the_infuse_limit_is_encoded() -> None:
    cloud = types.Pointcloud.from_points(
        np.arange(1_200_003.0).reshape(-1, 3), frame="mana/lidar", stamp_ns=0
    )
    assert wire_type(cloud) == "PointcloudLarge"
    data = encode(cloud)
    assert decode("PointcloudLarge", data) == cloud
    with pytest.raises(CodecError, match=r"expected 0\.\.400000"):
        decode("Pointcloud", data)
    with pytest.raises(CodecError, match="too large for Pointcloud: expected PointcloudLarge"):
        encode(cloud, "uper", "Pointcloud")
    assert decode("Pointcloud", encode(cloud, "msgpack"), "msgpack") == cloud
    wrapped = bitstream.wrap(cloud)
    assert wrapped.type == "PointcloudLarge"
    assert bitstream.unwrap(wrapped) == cloud


def test_the_size_is_checked_at_every_depth_of_a_message() -> None:
    image = types.Frame.from_image(np.zeros((4000, 4200, 4), np.uint8), stamp_ns=0, mode="RGBA")
    pair = types.FramePair(baseline=0.1, left=image, right=image)
    assert wire_type(image) == "FrameLarge"
    assert wire_type(pair) == "FramePairLarge"
    assert wire_type(types.FramesSequence((image,))) == "FramesSequenceLarge"
    assert wire_type(types.FramesSequence((types.Frame(),) * 10)) == "FramesSequence"
    assert wire_type(types.FramesSequence((types.Frame(),) * 11)) == "FramesSequenceLarge"


def test_other_types_are_refused() -> None:
    with pytest.raises(CodecError, match="a Time cannot be written as Pointcloud"):
        encode(types.Time(), "uper", "Pointcloud")


def test_size_variants_have_the_name_of_the_smaller_one_at_ports() -> None:
    assert base_type("PointcloudLarge") == base_type("Pointcloud") == "Pointcloud"
    assert base_type("Time") == "Time"


@pytest.mark.parametrize("name", sorted(LARGE))
def test_size_variants_share_a_class_and_differ_only_in_sizes(name: str, rng: np.random.Generator) -> None:
    assert MESSAGES[name].class_name == MESSAGES[LARGE[name]].class_name
    value = random_message(LARGE[name], rng)
    assert wire_type(value) == name
    assert encode(value, "msgpack", name) == encode(value, "msgpack", LARGE[name])
