# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Luma and colours of images, and refused colour orders."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.imaging.grey import grey_image, rgb_image

#: Red, green and blue, and their luma after ITU-R BT.601.
RGB, LUMA = (200, 100, 50), 124


@pytest.mark.parametrize(
    ("mode", "pixel"),
    [("RGB", RGB), ("BGR", RGB[::-1]), ("RGBA", (*RGB, 7)), ("BGRA", (*RGB[::-1], 7))],
)
def test_luma_and_colours_do_not_depend_on_the_order_of_the_channels(
    mode: str, pixel: tuple[int, ...]
) -> None:
    frame = Frame.from_image(np.full((2, 3, len(pixel)), pixel, np.uint8), stamp_ns=0, mode=mode)
    assert grey_image(frame).tolist() == [[LUMA] * 3] * 2
    assert rgb_image(frame).tolist() == [[list(RGB)] * 3] * 2


def test_a_grey_image_has_three_equal_colours() -> None:
    frame = Frame.from_image(np.arange(6, dtype=np.uint8).reshape(2, 3), stamp_ns=0)
    assert grey_image(frame).tolist() == [[0, 1, 2], [3, 4, 5]]
    assert rgb_image(frame)[1, 2].tolist() == [5, 5, 5]


@pytest.mark.parametrize("convert", [grey_image, rgb_image])
@pytest.mark.parametrize(("mode", "dtype"), [("HSV", np.uint8), ("GRAY", np.uint16)])
def test_another_colour_space_or_depth_is_refused(convert, mode: str, dtype: type) -> None:
    shape = (2, 3, 3) if mode == "HSV" else (2, 3)
    with pytest.raises(InputError, match="expected"):
        convert(Frame.from_image(np.zeros(shape, dtype), stamp_ns=0, mode=mode))
