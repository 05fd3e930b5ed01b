# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correlation of edge orientations with renderings of all sides of the body."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_pose_search.interface import Inputs, Interface, Outputs
from cdff_core.object_models.image_search import ImageSearch, ImageSearchConfig, body_light
from cdff_core.object_models.model import content_hash
from cdff_core.object_models.rendering import Window

#: Number of bodies whose renderings are kept, and smallest side of an image, pixels.
_BODIES, _SMALLEST_PX = 4, 32


class EdgeOrientationConfig(ImageSearchConfig, DfnConfig):
    """Parameters of EdgeOrientation."""


class EdgeOrientation(Interface[EdgeOrientationConfig]):
    """Search over views, roll angles and sizes; the best are refined by renderings."""

    def configure(self, config: EdgeOrientationConfig | dict[str, Any] | None = None) -> None:
        """Clear the renderings of bodies."""
        super().configure(config)
        self._searches: dict[str, ImageSearch] = {}

    def process(self, inputs: Inputs) -> Outputs:
        """Return distinct poses, best first; raises RefusedError or InputError."""
        image, K = inputs.image, inputs.camera_matrix
        if min(image.shape) < _SMALLEST_PX:
            raise InputError(f"image {image.shape}: expected at least {_SMALLEST_PX} x {_SMALLEST_PX}")
        if K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
            raise InputError(f"focal lengths {K[0, 0]:g}, {K[1, 1]:g} px: expected positive ones")
        light = body_light(image, self.config)
        camera = Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *image.shape)
        found = self._search(inputs).find(light, camera)
        return Outputs(
            poses=np.array([h.T for h in found]),
            scores=np.array([h.score for h in found]),
            agreements=np.array([[h.edges, h.inside, h.shading] for h in found]),
            light=np.array([*light.centre_px, light.extent_px]),
        )

    def _search(self, inputs: Inputs) -> ImageSearch:
        """Return the search of the body, whose renderings are kept for further images."""
        key = content_hash(inputs.vertices, inputs.triangles)
        if key not in self._searches:
            while len(self._searches) >= _BODIES:
                del self._searches[next(iter(self._searches))]
            self._searches[key] = ImageSearch(
                np.ascontiguousarray(inputs.vertices),
                np.ascontiguousarray(inputs.triangles),
                np.array(inputs.centre_m),
                inputs.diameter_m,
                self.config,
            )
        return self._searches[key]
