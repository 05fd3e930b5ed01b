# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What kinds of pixels a filter takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types import Frame


def eight_bit(frame: Frame) -> NDArray[np.uint8]:
    """Pixels of a grey or three-coloured 8-bit image; raises InputError for others."""
    image = frame.image
    if image.dtype != np.uint8 or (image.ndim == 3 and image.shape[2] != 3):
        raise InputError(f"image {image.dtype} {image.shape}: expected 8 bit, grey or three colours")
    return np.ascontiguousarray(image)
