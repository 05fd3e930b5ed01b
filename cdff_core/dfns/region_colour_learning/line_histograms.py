# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Histograms of the colours on both sides of the outline of a body."""

from __future__ import annotations

import numpy as np
from numba import njit
from pydantic import Field

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.region_colour_learning.interface import Inputs, Interface, Outputs
from cdff_core.object_models.outline import Outline, OutlineEdges, check_channels, colour_bin, outline
from cdff_core.object_models.rendering import Window


class LineHistogramsConfig(DfnConfig):
    """Parameters of LineHistograms."""

    bins: int = Field(16, ge=2, le=64, description="Bins of each channel")
    spacing_px: float = Field(3.0, ge=1, le=100, description="Distance of the lines, px")
    reach_px: float = Field(
        20.0, ge=4, le=200, description="Length of a line on each side of the outline, px"
    )
    margin_px: float = Field(
        1.5, ge=0, le=20, description="Distance from the outline below which pixels are not used, px"
    )
    rate: float = Field(0.2, gt=0, le=1, description="Weight of an image relative to the images before it")


class LineHistograms(Interface[LineHistogramsConfig]):
    """Colours along the normals of the outline, on the body and next to it; each image adds a part
    (Stoiber et al. 2022, doi:10.1007/s11263-022-01579-8).
    """

    def setup(self) -> None:
        """Clear the edges of the last mesh."""
        self._edges = OutlineEdges()

    def process(self, inputs: Inputs) -> Outputs:
        """Return the frequencies of the colours; raises InputError."""
        cfg, K = self.config, inputs.camera_matrix
        check_channels(inputs.image)
        size = cfg.bins ** inputs.image.shape[2]
        for name, colours in (("body", inputs.body_colours), ("background", inputs.background_colours)):
            if colours is not None and len(colours) != size:
                raise InputError(f"{name}_colours: {len(colours)}, expected {size}")
        edges = self._edges.of(inputs.vertices, inputs.triangles)
        camera = Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *inputs.image.shape[:2])
        lines = outline(
            edges,
            inputs.vertices,
            inputs.triangles,
            inputs.pose,
            camera,
            spacing_px=cfg.spacing_px,
            reach_px=cfg.reach_px,
        )
        counts = _counts(lines, np.ascontiguousarray(inputs.image), cfg.bins, size, cfg.margin_px)
        body, background = (
            _mixed(new, old, cfg.rate)
            for new, old in zip(counts, (inputs.body_colours, inputs.background_colours), strict=True)
        )
        return Outputs(body_colours=body, background_colours=background, pixels=int(counts[0].sum()))


def _mixed(counts: FloatArray, previous: FloatArray | None, rate: float) -> FloatArray:
    """Return the frequencies of counts (b,), mixed with the previous ones unless these are of no pixel."""
    total = float(counts.sum())
    if total == 0.0:
        return counts if previous is None else previous
    if previous is None or not previous.any():
        return counts / total
    return (1.0 - rate) * previous + rate * counts / total


@njit(cache=True)
def _counts(
    lines: Outline, image: ByteArray, bins: int, size: int, margin_px: float
) -> FloatArray:  # pragma: no cover - compiled
    """Return the numbers (2, size) of pixels of each colour inside and outside of the outline."""
    counts = np.zeros((2, size))
    for i in range(len(lines.pixels)):
        for side in range(2):
            length = lines.inside_px[i] if side == 0 else lines.outside_px[i]
            sign = -1.0 if side == 0 else 1.0
            s = margin_px
            while s <= length - margin_px:
                c = int(np.rint(lines.pixels[i, 0] + sign * s * lines.normals[i, 0]))
                r = int(np.rint(lines.pixels[i, 1] + sign * s * lines.normals[i, 1]))
                if 0 <= c < image.shape[1] and 0 <= r < image.shape[0]:
                    counts[side, colour_bin(image, r, c, bins)] += 1.0
                s += 1.0
    return counts
