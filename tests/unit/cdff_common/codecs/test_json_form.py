# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages as JSON: octets and what is not finite survive."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import encode
from cdff_common.codecs.json_form import from_json, json_safe
from cdff_common.codecs.plain import to_plain
from cdff_common.errors import CodecError


@pytest.mark.parametrize(
    "value",
    [
        types.Frame.from_image(np.arange(6, dtype=np.uint8).reshape(2, 3), stamp_ns=7000),  # its place is unknown: NaN
        types.Pointcloud.from_points(np.array([[1.0, np.nan, 3.0]]), frame="a", stamp_ns=0),
        types.RigidBodyState(),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_message_survives_json(value: types.Frame) -> None:
    text = json.dumps(json_safe(to_plain(value)), allow_nan=False)
    assert encode(from_json(type(value).__name__, json.loads(text)), "uper") == encode(value, "uper")


@pytest.mark.parametrize("octets", ["0g", "012"])
def test_what_are_no_octets_is_refused_by_field(octets: str) -> None:
    with pytest.raises(CodecError, match=r"Frame\.data\.data: expected hexadecimal digits"):
        from_json("Frame", {"data": {"data": octets}})
