# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of edges as lines one pixel wide.

References
----------
.. [1] Canny, J. (1986). A computational approach to edge detection. IEEE TPAMI 8(6).
  doi:10.1109/TPAMI.1986.4767851
"""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import FrameModeT
from cdff_core.dfns.image_filtering.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import with_image
from cdff_core.imaging.grey import grey_image


class CannyEdgeDetectionConfig(DfnConfig):
    """Parameters of CannyEdgeDetection."""

    sigma_px: float = Field(
        1.0, ge=0, le=50, description="Standard deviation of the smoothing; 0 disables it"
    )
    low_grey: float = Field(
        50.0, ge=0, le=2000, description="Length of the Sobel gradient down to which an edge is continued"
    )
    high_grey: float = Field(
        100.0, ge=0, le=2000, description="Length of the Sobel gradient at which an edge can start"
    )


class CannyEdgeDetection(Interface[CannyEdgeDetectionConfig]):
    """Canny edge detection [1]_ with the Euclidean length of the Sobel gradient."""

    def setup(self) -> None:
        """Raise ConfigurationError if the low threshold is above the high one."""
        c = self.config
        if c.low_grey > c.high_grey:
            raise ConfigurationError(
                f"CannyEdgeDetection: low_grey={c.low_grey} above high_grey={c.high_grey}"
            )

    def process(self, inputs: Inputs) -> Outputs:
        """Return 255 on edges, 0 elsewhere; raises InputError if the image is not of 8 bit."""
        c, grey = self.config, grey_image(inputs.image)
        if c.sigma_px:
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), c.sigma_px), dtype=np.uint8)
        edges = cv2.Canny(np.ascontiguousarray(grey), c.low_grey, c.high_grey, L2gradient=True)
        return Outputs(image=with_image(inputs.image, np.asarray(edges), mode=FrameModeT.MODE_GRAY))
