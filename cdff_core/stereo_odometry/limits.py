# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of measured values with their limits: refusal, or a reason for DEGRADED."""

from __future__ import annotations

from cdff_common.errors import RefusedError

#: Sharpness (BandEnergy) below which the blur is 2 px or more, and sharpness relative to that of the
#: keyframe below which the finest octave is missing.
GOOD_SHARPNESS, GOOD_SHARPNESS_RATIO = 0.25, 0.6

#: Largest row offset between the images at the centre, pixels. With a larger one, matches are lost (their
#: rows may differ by 1 px) and the disparities of slanted edges are biased.
MAX_ROW_OFFSET_PX = 0.5


def require(value: float, least: float, reason: str) -> None:
    """Raise RefusedError with ``reason:value<least`` if a count or fraction is less than ``least``."""
    if reasons := below(value, least, reason):
        raise RefusedError(f"{reason}: {value:.2g}, expected at least {least:g}", reasons)


def blur_reasons(sharpness: float, reference: float = 0.0) -> list[str]:
    """Return the reason ``blurred`` if an image is blurred, absolutely or relative to the keyframe."""
    return below(sharpness, max(GOOD_SHARPNESS, GOOD_SHARPNESS_RATIO * reference), "blurred")


def rectification_reasons(row_offset_px: float) -> list[str]:
    """Return the reason ``row_offset`` if the rows of the two images differ by too many pixels."""
    if abs(row_offset_px) <= MAX_ROW_OFFSET_PX:
        return []
    return [f"row_offset:{abs(row_offset_px):.2f}>{MAX_ROW_OFFSET_PX:.2f}"]


def below(value: float, least: float, reason: str, digits: int = 2) -> list[str]:
    """Return ``reason:value<least`` if a value is less than ``least``; counts have no decimals."""
    digits = 0 if isinstance(value, int) else digits
    return [f"{reason}:{value:.{digits}f}<{least:.{digits}f}"] if value < least else []
