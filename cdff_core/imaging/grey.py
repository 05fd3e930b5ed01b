# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From what cameras deliver to the grey image that feature work is done on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types import Frame, FrameModeT

#: Weights of red, green and blue in luma (ITU-R BT.601-7 §2.5.1).
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
_ORDERS = {
    FrameModeT.MODE_RGB: (0, 1, 2),
    FrameModeT.MODE_RGBA: (0, 1, 2),
    FrameModeT.MODE_BGR: (2, 1, 0),
    FrameModeT.MODE_BGRA: (2, 1, 0),
}


def grey_image(frame: Frame) -> NDArray[np.uint8]:
    """The luma of a frame, shape (rows, cols), uint8; a view where it is grey already.

    Raises
    ------
    InputError
        On a pixel type or colour order that is not known here.
    """
    image = frame.image
    if image.dtype != np.uint8:
        raise InputError(f"image {image.dtype}: expected uint8; convert deeper images before")
    if image.ndim == 2:
        return image
    order = _ORDERS.get(frame.metadata.mode)
    if order is None or image.shape[2] < 3:
        raise InputError(f"image {image.shape} in mode {frame.metadata.mode.name}: expected GRAY, RGB(A) or BGR(A)")
    colours = image[:, :, list(order)].astype(np.float32)
    return np.asarray(np.rint(colours @ _LUMA), dtype=np.uint8)
