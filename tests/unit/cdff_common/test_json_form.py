# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from cdff_common.json_form import jsonable


def test_stamps_become_decimal_strings_at_any_depth_and_other_numbers_are_unchanged() -> None:
    data = {
        "t0_ns": 1_700_000_000_123_456_000,
        "items": [{"stamp_ns": 5, "count": 7}],
        "no": ({"t1_ns": None},),
    }
    assert jsonable(data) == {
        "t0_ns": "1700000000123456000",
        "items": [{"stamp_ns": "5", "count": 7}],
        "no": [{"t1_ns": None}],
    }


def test_octets_are_hexadecimal_and_nan_is_null() -> None:
    assert jsonable({"sha256": b"\x01\xff", "age_s": float("nan")}) == {"sha256": "01ff", "age_s": None}
