# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time stamps as text, and the mission clock."""

from datetime import datetime, timedelta, timezone

import pytest

from cdff_common import clock
from cdff_common.errors import InputError


def test_stamps_are_read_from_nanoseconds_and_from_rfc_3339() -> None:
    assert clock.parse_stamp("1785585600000000000") == 1785585600000000000
    assert clock.parse_stamp("2026-08-01T12:00:00Z") == 1785585600000000000
    assert clock.parse_stamp("2026-08-01T14:00:00.000001+02:00") == 1785585600000001000


def test_a_stamp_survives_its_text_form() -> None:
    stamp = 1785585600123456000
    assert clock.parse_stamp(clock.format_stamp(stamp)) == stamp


@pytest.mark.parametrize("text", ["", "now", "2026-08-01T12:00:00", "1785585600000000001", "1e9"])
def test_malformed_stamps_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        clock.parse_stamp(text)


@pytest.mark.parametrize(
    "text", ["9223372036854776000", "9990000000000000000", "-9990000000000000000", "2300-01-01T00:00:00Z"]
)
def test_a_stamp_that_does_not_fit_64_bits_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="64 bits"):
        clock.parse_stamp(text)


def test_the_latest_stamp_of_64_bits_is_accepted() -> None:
    assert clock.parse_stamp("9223372036854775000") == 9223372036854775000


def test_stamps_and_datetimes_convert_both_ways() -> None:
    moment = datetime(2026, 11, 20, 12, 0, 0, 250_000, tzinfo=timezone(timedelta(hours=1)))
    stamp_ns = clock.from_datetime(moment)
    assert clock.to_datetime(stamp_ns) == moment
    assert clock.format_stamp(stamp_ns) == "2026-11-20T11:00:00.250000Z"
    with pytest.raises(InputError, match="time zone"):
        clock.from_datetime(moment.replace(tzinfo=None))
