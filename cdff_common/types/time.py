# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/time.asn by cdff generate; do not edit.

"""Types of ``asn1/time.asn``."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from cdff_common.types.time_ext import TimeExt


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Time(TimeExt):
    """Point in time since the UNIX epoch.

    Attributes
    ----------
    microseconds : int, -9223372036854775807..9223372036854775807
        microseconds since 1970-01-01T00:00:00Z.
    usec_per_sec : int, -2147483648..2147483647
        microseconds per second of that count: 1000000.
    """

    ASN1_NAME: ClassVar[str] = "Time"
    microseconds: int = 0
    usec_per_sec: int = 1000000


class Resolution(IntEnum):
    """``Resolution``."""

    SECONDS = 0
    MILLISECONDS = 1
    MICROSECONDS = 2
