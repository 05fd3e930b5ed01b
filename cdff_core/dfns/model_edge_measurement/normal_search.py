# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search for image edges along the normals of the drawn edges of a mesh."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry.robust import median_sigma
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.model_edge_measurement.interface import Inputs, Interface, Outputs
from cdff_core.object_models.mesh_edges import MeshEdges, mesh_edges, visible_edge_points
from cdff_core.object_models.rendering import Window

#: Weights of five samples whose sum is the slope, and of the mean of three lines.
_SLOPE = np.array([-0.125, -0.25, 0.0, 0.25, 0.125], np.float32)
_MEAN = np.full(3, 1.0 / 3.0, np.float32)
#: Distance from the control points in which the noise is estimated, px, and step of its rows and columns.
_AROUND_PX, _NOISE_STEP = 20.0, 3


class NormalSearchConfig(DfnConfig):
    """Parameters of NormalSearch."""

    spacing_px: float = Field(4.0, ge=1, le=100, description="Distance of the control points, px")
    max_points: int = Field(1500, ge=20, le=100_000, description="Largest number of control points")
    crease_deg: float = Field(20.0, ge=1, le=180, description="Angle of two faces from which it is an edge")
    hypotheses: int = Field(4, ge=1, le=20, description="Largest number of image edges of a control point")
    contrast: float = Field(
        0.02, gt=0, lt=1, description="Step of an image edge, relative to the range of grey values"
    )
    min_noise_ratio: float = Field(
        3.0,
        ge=0,
        le=100,
        description="Step of an image edge, relative to the standard deviation of steps around the body",
    )


class NormalSearch(Interface[NormalSearchConfig]):
    """One-dimensional search for extrema of the derivative (Harris and Stennett 1990, RAPID), with several
    hypotheses for each point (Vacchetti et al. 2004, doi:10.1109/ISMAR.2004.24).
    """

    def setup(self) -> None:
        """Clear the edges of the last mesh."""
        self._mesh: tuple[FloatArray, np.ndarray] | None = None

    def process(self, inputs: Inputs) -> Outputs:
        """Return control points and offsets; raises InputError."""
        if not len(inputs.triangles):
            raise InputError(f"{len(inputs.vertices)} vertices and no triangle, expected a mesh")
        edges = self._edges_of(inputs)
        K, T_camera_model = inputs.camera_matrix, np.ascontiguousarray(inputs.pose, np.float64)
        rows, columns = inputs.image.shape
        cfg, camera = self.config, Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], rows, columns)
        points, pixels, normals = visible_edge_points(
            edges, inputs.vertices, inputs.triangles, T_camera_model, camera, cfg.spacing_px
        )
        if not len(points):
            offsets = np.zeros((0, cfg.hypotheses))
            return Outputs(points=points, pixels=pixels, normals=normals, offsets=offsets)
        step = -(-len(points) // cfg.max_points)
        points, pixels, normals = points[::step], pixels[::step], normals[::step]
        slopes = slopes_along(inputs.image, pixels, normals, math.ceil(inputs.range_px) + 3)
        noise = _slope_noise(_part(inputs.image, pixels, _AROUND_PX + inputs.range_px))
        # The slope is half of the step.
        min_slope = max(0.5 * cfg.contrast * float(np.ptp(inputs.image)), cfg.min_noise_ratio * noise, 1e-30)
        offsets = strongest_extrema(slopes, inputs.range_px, cfg.hypotheses, min_slope)
        return Outputs(points=points, pixels=pixels, normals=normals, offsets=offsets)

    def _edges_of(self, inputs: Inputs) -> MeshEdges:
        """Return the edges of the mesh; computed once for the same arrays."""
        mesh = (inputs.vertices, inputs.triangles)
        if self._mesh is None or any(old is not new for old, new in zip(self._mesh, mesh, strict=True)):
            crease_rad = math.radians(self.config.crease_deg)
            self._edges = mesh_edges(inputs.vertices, inputs.triangles, crease_rad)
            self._mesh = mesh
        return self._edges


def _part(image: Float32Array, pixels: FloatArray, margin_px: float) -> Float32Array:
    """Return the part of an image around pixels (n, 2), column and row."""
    low = np.maximum(pixels.min(axis=0) - margin_px, 0.0).astype(int)
    high = np.ceil(pixels.max(axis=0) + margin_px).astype(int) + 1
    return np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]])


def _slope_noise(image: Float32Array) -> float:
    """Return the standard deviation of the slopes along the rows and columns of an image.

    The slopes have the same weights as those of ``slopes_along``. Their median is used, because few pixels
    are on edges.
    """
    slopes = [
        cv2.sepFilter2D(image, cv2.CV_32F, *kernels)[2:-2:_NOISE_STEP, 2:-2:_NOISE_STEP].ravel()
        for kernels in ((_SLOPE, _MEAN), (_MEAN, _SLOPE))
    ]
    samples = np.concatenate(slopes).astype(np.float64)
    return median_sigma(samples) if len(samples) else 0.0


@njit(cache=True)
def slopes_along(
    image: Float32Array, pixels: FloatArray, normals: FloatArray, half: int
) -> Float32Array:  # pragma: no cover - compiled
    """Return the smoothed derivatives (n, 2 half + 1) of the grey values along the normals, per pixel.

    The profile is sampled every pixel by bilinear interpolation and averaged over three pixels along the
    edge. The two derivatives at each end are 0. A derivative is NaN if a sample is outside the image.
    """
    count = 2 * half + 1
    profile, slopes = np.empty(count), np.zeros((len(pixels), count), np.float32)
    for i in range(len(pixels)):
        nu, nv = normals[i, 0], normals[i, 1]
        for k in range(count):
            total, pixels_used = 0.0, 0
            for along in range(-1, 2):
                u = pixels[i, 0] + (k - half) * nu - along * nv
                v = pixels[i, 1] + (k - half) * nv + along * nu
                c, r = int(np.floor(u)), int(np.floor(v))
                if c < 0 or r < 0 or c >= image.shape[1] - 1 or r >= image.shape[0] - 1:
                    continue
                a, b = u - c, v - r
                upper = (1.0 - a) * image[r, c] + a * image[r, c + 1]
                lower = (1.0 - a) * image[r + 1, c] + a * image[r + 1, c + 1]
                total += (1.0 - b) * upper + b * lower
                pixels_used += 1
            profile[k] = total / pixels_used if pixels_used else np.nan
        for k in range(2, count - 2):
            # Derivative of a quadratic smoother of five samples, as _SLOPE.
            slopes[i, k] = 0.25 * (profile[k + 1] - profile[k - 1]) + 0.125 * (
                profile[k + 2] - profile[k - 2]
            )
    return slopes


@njit(cache=True)
def strongest_extrema(
    slopes: Float32Array, range_px: float, hypotheses: int, min_slope: float
) -> FloatArray:  # pragma: no cover - compiled
    """Return the offsets (n, hypotheses), pixels, of the strongest extrema of derivatives (n, 2 half + 1).

    An extremum is used if its offset is within the range and its derivative is at least ``min_slope``. The
    remaining offsets are NaN.
    """
    n, count = slopes.shape
    offsets = np.full((n, hypotheses), np.nan)
    strength = np.empty(hypotheses)
    for i in range(n):
        strength[:] = 0.0
        for k in range(3, count - 3):
            s = float(abs(slopes[i, k]))
            before, after = float(abs(slopes[i, k - 1])), float(abs(slopes[i, k + 1]))
            if not (s >= min_slope and s >= before and s > after):
                continue
            offset = k - count // 2 + 0.5 * (before - after) / (before - 2.0 * s + after)
            if abs(offset) > range_px:
                continue
            for h in range(hypotheses):
                if s > strength[h]:
                    for j in range(hypotheses - 1, h, -1):
                        strength[j], offsets[i, j] = strength[j - 1], offsets[i, j - 1]
                    strength[h], offsets[i, h] = s, offset
                    break
    return offsets
