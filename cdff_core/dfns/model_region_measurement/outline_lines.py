# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Posterior of the offset of the outline along its normals, from colour histograms."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.model_region_measurement.interface import Inputs, Interface, Outputs
from cdff_core.object_models.outline import Outline, OutlineEdges, check_channels, colour_bin, outline
from cdff_core.object_models.rendering import Window

#: Offsets on each side, and segments of a line beyond the largest offset.
_OFFSETS, _BEYOND = 6, 4
#: Frequency added to each colour, relative to that of evenly distributed colours.
_FLOOR = 0.1


class OutlineLinesConfig(DfnConfig):
    """Parameters of OutlineLines."""

    spacing_px: float = Field(3.0, ge=1, le=100, description="Distance of the lines, px")
    max_lines: int = Field(400, ge=20, le=100_000, description="Largest number of lines")
    clear_segments: float = Field(
        3.0, ge=1, le=10, description="Segments on each side that must be only body, or only background"
    )
    slope: float = Field(0.5, gt=0, le=5, description="Blur of the outline, segments")
    amplitude: float = Field(
        0.43,
        gt=0,
        lt=0.5,
        description="Probability that a pixel has the side of the outline it is on, minus 1/2",
    )
    max_spread: float = Field(
        0.8,
        gt=0,
        le=1,
        description="Standard deviation of the offset, relative to that of evenly distributed offsets, from "
        "which a line is not used",
    )


class OutlineLines(Interface[OutlineLinesConfig]):
    """Correspondence lines with smoothed step functions (Stoiber et al. 2022,
    doi:10.1007/s11263-022-01579-8): the lines are divided into segments, whose size follows from the range.
    """

    def setup(self) -> None:
        """Clear the edges of the last mesh."""
        self._edges = OutlineEdges()

    def process(self, inputs: Inputs) -> Outputs:
        """Return points of the outline with their offsets; raises InputError."""
        cfg, K = self.config, inputs.camera_matrix
        check_channels(inputs.image)
        channels = inputs.image.shape[2]
        bins = round(len(inputs.body_colours) ** (1.0 / channels))
        if bins**channels != len(inputs.body_colours):
            raise InputError(
                f"{len(inputs.body_colours)} colours, expected the same number of bins for each "
                f"of {channels} channels"
            )
        edges = self._edges.of(inputs.vertices, inputs.triangles)
        camera = Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *inputs.image.shape[:2])
        scale = max(1, math.ceil(inputs.range_px / _OFFSETS))
        lines = outline(
            edges,
            inputs.vertices,
            inputs.triangles,
            inputs.pose,
            camera,
            spacing_px=cfg.spacing_px,
            reach_px=float(scale * (_OFFSETS + _BEYOND)),
        )
        clear_px = cfg.clear_segments * scale
        rows = np.flatnonzero((lines.inside_px >= clear_px) & (lines.outside_px >= clear_px))
        rows = rows[:: max(1, -(-len(rows) // cfg.max_lines))]
        lines = Outline(*(array[rows] for array in lines))
        if not (inputs.body_colours.any() and inputs.background_colours.any()):
            lines = Outline(*(array[:0] for array in lines))  # colours of no pixel separate nothing
        floor = _FLOOR / len(inputs.body_colours)
        body, background = inputs.body_colours + floor, inputs.background_colours + floor
        body_share = body / (body + background)
        image = np.ascontiguousarray(inputs.image)
        offsets = _offsets(lines, image, bins, body_share, scale, cfg.slope, cfg.amplitude)
        uniform_sigma_px = scale * math.sqrt(_OFFSETS * (_OFFSETS + 1) / 3.0)
        is_precise = offsets[:, 1] < cfg.max_spread * uniform_sigma_px
        return Outputs(
            points=lines.points[is_precise],
            pixels=lines.pixels[is_precise],
            normals=lines.normals[is_precise],
            offsets=offsets[is_precise, :1],
            sigmas=offsets[is_precise, 1],
        )


@njit(cache=True)
def _offsets(
    lines: Outline,
    image: ByteArray,
    bins: int,
    share: FloatArray,
    scale: int,
    slope: float,
    amplitude: float,
) -> FloatArray:  # pragma: no cover - compiled
    """Return mean and standard deviation (n, 2) of the offsets; infinite without pixels.

    Parameters
    ----------
    share : ndarray, shape (b,)
        Probability that a pixel of a colour is of the body.
    """
    half = _OFFSETS + _BEYOND
    step = np.empty(2 * (half + _OFFSETS) + 1)
    for k in range(len(step)):
        step[k] = 0.5 - amplitude * np.tanh(0.5 * (k - half - _OFFSETS) / slope)
    result = np.full((len(lines.pixels), 2), np.inf)
    log_body, log_background = np.log(share), np.log(1.0 - share)
    of_body = np.empty(2 * half + 1)
    for i in range(len(lines.pixels)):
        count = 0
        for k in range(2 * half + 1):
            total_body, total_background, pixels_inside = 0.0, 0.0, 0
            for j in range(scale):
                s = (k - half) * scale + j - 0.5 * (scale - 1)
                c = int(np.rint(lines.pixels[i, 0] + s * lines.normals[i, 0]))
                r = int(np.rint(lines.pixels[i, 1] + s * lines.normals[i, 1]))
                if 0 <= c < image.shape[1] and 0 <= r < image.shape[0]:
                    colour = colour_bin(image, r, c, bins)
                    total_body += log_body[colour]
                    total_background += log_background[colour]
                    pixels_inside += 1
            count += pixels_inside
            difference = total_background - total_body
            of_body[k] = 0.5 if not pixels_inside else 1.0 / (1.0 + np.exp(min(max(difference, -50.0), 50.0)))
        if not count:
            continue
        best, logs = -np.inf, np.empty(2 * _OFFSETS + 1)
        for d in range(2 * _OFFSETS + 1):
            total = 0.0
            for k in range(2 * half + 1):
                h = step[k - d + 2 * _OFFSETS]
                total += np.log(h * of_body[k] + (1.0 - h) * (1.0 - of_body[k]))
            logs[d] = total
            best = max(best, total)
        weight, mean, square = 0.0, 0.0, 0.0
        for d in range(2 * _OFFSETS + 1):
            p = np.exp(logs[d] - best)
            x = (d - _OFFSETS) * scale
            weight += p
            mean += p * x
            square += p * x * x
        mean /= weight
        # Offsets between two segments add the variance of a segment.
        variance = square / weight - mean * mean + scale * scale / 12.0
        result[i, 0], result[i, 1] = mean, np.sqrt(variance)
    return result
