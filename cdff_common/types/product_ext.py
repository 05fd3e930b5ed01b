# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of product metadata."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Box, Message


class ProductMetadataExt(Message):
    """Header of a product with encoding and size of its payload."""

    __slots__ = ()
    has_box: bool
    box: NDArray[np.float64]

    def extent_m(self) -> Box | None:
        """Return the stated box, or None."""
        if not self.has_box:
            return None
        b = [float(v) for v in self.box]
        return (b[0], b[1], b[2], b[3], b[4], b[5])
