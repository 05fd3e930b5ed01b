# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Colour conversion: round trips, luma, and refused conversions."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.dfns.color_conversion.interface import ColorConversionInputs
from cdff_core.dfns.color_conversion.open_cv import OpenCv


def convert(frame: Frame, mode: str) -> Frame:
    node = OpenCv()
    node.configure({"mode": mode})
    return node.process(ColorConversionInputs(image=frame)).image


def rgb(rng: np.random.Generator, dtype: type = np.uint8) -> Frame:
    return Frame.from_image(
        rng.integers(0, np.iinfo(dtype).max, (6, 7, 3), dtype=dtype), stamp_ns=3000, mode="RGB"
    )


@pytest.mark.parametrize("mode", ["BGR", "RGBA", "BGRA"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_channel_orders_are_converted_in_both_directions(
    rng: np.random.Generator, mode: str, dtype: type
) -> None:
    frame = rgb(rng, dtype)
    in_mode = convert(frame, mode)
    assert in_mode.metadata.mode.name == f"MODE_{mode}"
    assert in_mode.stamp_ns == 3000
    assert (convert(in_mode, "RGB").image == frame.image).all()


@pytest.mark.parametrize("mode", ["HSV", "HLS"])
def test_hue_is_converted_in_both_directions_within_eight_bits(rng: np.random.Generator, mode: str) -> None:
    frame = rgb(rng)
    round_trip = convert(convert(frame, mode), "RGB").image
    assert np.abs(round_trip.astype(int) - frame.image).max() <= 12


def test_grey_is_the_weighted_mean_of_red_green_and_blue(rng: np.random.Generator) -> None:
    frame = rgb(rng)
    expected = frame.image @ np.array([0.299, 0.587, 0.114])
    assert np.abs(convert(frame, "GRAY").image - expected).max() <= 0.51
    assert convert(convert(frame, "BGRA"), "GRAY").image == pytest.approx(expected, abs=1)


def test_invalid_conversions_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="uint16"):
        convert(rgb(rng, np.uint16), "HSV")
    with pytest.raises(InputError, match="float32"):
        convert(Frame.from_image(np.zeros((3, 3, 3), np.float32), stamp_ns=0, mode="RGB"), "BGR")
    with pytest.raises(InputError, match="mode UNDEF"):
        convert(Frame.from_image(np.zeros((3, 3, 5), np.uint8), stamp_ns=0, mode="UNDEF"), "GRAY")
