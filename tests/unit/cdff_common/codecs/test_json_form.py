# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages as JSON: octets and non-finite values."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import encode
from cdff_common.codecs.dict_form import to_dict_form
from cdff_common.codecs.json_form import from_json
from cdff_common.errors import CodecError
from cdff_common.json_form import jsonable


@pytest.mark.parametrize(
    "value",
    [
        types.Frame.from_image(
            np.arange(6, dtype=np.uint8).reshape(2, 3), stamp_ns=7000
        ),  # its pose is unknown: NaN
        types.Pointcloud.from_points(np.array([[1.0, np.nan, 3.0]]), frame="a", stamp_ns=0),
        types.RigidBodyState(),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_message_survives_a_json_round_trip(value: types.Frame) -> None:
    text = json.dumps(jsonable(to_dict_form(value)), allow_nan=False)
    assert encode(from_json(type(value).__name__, json.loads(text)), "uper") == encode(value, "uper")


@pytest.mark.parametrize("octets", ["0g", "012"])
def test_invalid_octets_are_refused_by_field(octets: str) -> None:
    with pytest.raises(CodecError, match=r"Frame\.data\.data: expected hexadecimal digits"):
        from_json("Frame", {"data": {"data": octets}})
