# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Colours: there and back, and what cannot be converted."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.dfns.color_conversion._interface import ColorConversionInputs
from cdff_core.dfns.color_conversion.open_cv import OpenCv


def converted(frame: Frame, mode: str) -> Frame:
    node = OpenCv()
    node.configure({"mode": mode})
    return node.process(ColorConversionInputs(image=frame)).image


def rgb(rng: np.random.Generator, dtype: type = np.uint8) -> Frame:
    return Frame.from_image(rng.integers(0, np.iinfo(dtype).max, (6, 7, 3), dtype=dtype), stamp_ns=3000, mode="RGB")


@pytest.mark.parametrize("mode", ["BGR", "RGBA", "BGRA"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_orders_of_colours_go_there_and_back(rng: np.random.Generator, mode: str, dtype: type) -> None:
    frame = rgb(rng, dtype)
    there = converted(frame, mode)
    assert there.metadata.mode.name == f"MODE_{mode}"
    assert there.stamp_ns == 3000
    assert (converted(there, "RGB").image == frame.image).all()


@pytest.mark.parametrize("mode", ["HSV", "HLS"])
def test_hue_goes_there_and_back_as_far_as_eight_bits_hold_it(rng: np.random.Generator, mode: str) -> None:
    frame = rgb(rng)
    back = converted(converted(frame, mode), "RGB").image
    assert np.abs(back.astype(int) - frame.image).max() <= 12


def test_grey_is_luma(rng: np.random.Generator) -> None:
    frame = rgb(rng)
    expected = frame.image @ np.array([0.299, 0.587, 0.114])
    assert np.abs(converted(frame, "GRAY").image - expected).max() <= 0.51
    assert converted(converted(frame, "BGRA"), "GRAY").image == pytest.approx(expected, abs=1)


def test_what_cannot_be_converted_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="uint16"):
        converted(rgb(rng, np.uint16), "HSV")
    with pytest.raises(InputError, match="float32"):
        converted(Frame.from_image(np.zeros((3, 3, 3), np.float32), stamp_ns=0, mode="RGB"), "BGR")
    with pytest.raises(InputError, match="mode UNDEF"):
        converted(Frame.from_image(np.zeros((3, 3, 5), np.uint8), stamp_ns=0, mode="UNDEF"), "GRAY")
