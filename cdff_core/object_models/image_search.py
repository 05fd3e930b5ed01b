# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search of a known body in one image with a dark background: its light, views of all sides, refinement.

1. The light of the body is the largest region brighter than the background, away from a bright border.
2. Renderings of the body from all sides, at several roll angles and sizes, are correlated with the image.
3. The best ones are refined by CMA-ES on renderings at the resolution of the image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.fft import fft2, ifft2

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import StrictModel
from cdff_core.object_models.evolution import minimise
from cdff_core.object_models.image_fields import ImageField, agreement, body_field, window_field
from cdff_core.object_models.rendering import Window
from cdff_core.object_models.views import directions, view_rotation

#: Side of the windows of the correlation, and diameter of the rendered body in them, pixels.
_COARSE_PX, _COARSE_BODY_PX = 64, 30
#: Distance of the rendered views, diameters, and number of views that are correlated at once.
_DISTANCE, _BATCH = 8.0, 64
#: Extent of the body relative to that of its light, smallest and largest, and number of steps between them.
_SIZES, _SIZE_STEPS = (0.85, 2.0), 6
#: Weights of the light inside the outline and of the shading, relative to that of the edges.
_INSIDE, _SHADING = 2.0, 0.5
#: Grey level of the background, and its standard deviation, above which it is not dark.
_BRIGHT, _VARYING = 64.0, 6.0
LARGEST_SCORE = 1.0 + _INSIDE + _SHADING
#: Part of the light that may be outside without cost: halo, and parts that the mesh does not have.
_OUTSIDE = 0.05
#: Side of the windows of the refinement, pixels, and their extent relative to the light.
_FINE_PX, _FINE_EXTENT = 128, 2.8
#: Standard deviations at the start of the refinement: rotation, rad; position, diameters; logarithm of range.
_SPREAD = np.array([0.12, 0.12, 0.12, 0.03, 0.03, 0.06])


class ImageSearchConfig(StrictModel):
    """Parameters of the search in an image."""

    views: int = Field(
        100, ge=20, le=1000, description="Number of directions from which the body is rendered"
    )
    rolls: int = Field(18, ge=4, le=90, description="Number of roll angles of each direction")
    candidates: int = Field(24, ge=1, le=200, description="Number of poses that are refined")
    hypotheses: int = Field(4, ge=1, le=20, description="Largest number of poses of the result")
    distinct_deg: float = Field(
        20.0, gt=0, le=90, description="Smallest angle between two poses of the result"
    )
    max_border: float = Field(
        0.05, ge=0, le=1, description="Part of the border of the image with light above which it is refused"
    )
    min_light: float = Field(
        5e-4, gt=0, lt=1, description="Part of the image below which a region of light is not a body"
    )
    seed: int = Field(0, ge=0, le=2**31, description="Seed of the refinement")


class BodyLight(NamedTuple):
    """Light of a body in an image.

    Attributes
    ----------
    signal : ndarray of float32, shape (rows, columns)
        Grey levels above the background; 0 outside the region of the body.
    centre_px : ndarray, shape (2,)
        Centre of the circle around the region: column, row.
    extent_px : float
        Diameter of the circle.
    """

    signal: NDArray[np.float32]
    centre_px: FloatArray
    extent_px: float


class _Views(NamedTuple):
    """Conjugate spectra (n, rows, columns) of the edges and of the outline with its seam, and norms (n,)."""

    edges: NDArray[np.complex64]
    seams: NDArray[np.complex64]
    norms: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class ImageHypothesis:
    """A pose T_camera_model (4, 4) with its score: edges, light inside and shading, 0 to 3.5."""

    T: FloatArray
    score: float
    edges: float
    inside: float
    shading: float


def body_light(image: NDArray[np.uint8], config: ImageSearchConfig) -> BodyLight:
    """Return the light of the body in a grey image of 8 bits.

    Raises
    ------
    RefusedError
        ``bright_background``, ``no_light``.
    """
    scale = max(1.0, max(image.shape) / 480.0)
    size = (round(image.shape[1] / scale), round(image.shape[0] / scale))
    small = cv2.GaussianBlur(
        cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32), (0, 0), 1
    )
    background = float(np.median(small))
    noise = 1.4826 * float(np.median(np.abs(small - background)))
    mask = (small > background + max(6.0 * noise, 6.0)).astype(np.uint8)
    border = float(np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).mean())
    if background > _BRIGHT or noise > _VARYING:
        raise RefusedError(
            f"background of {background:.0f} grey levels that varies by {noise:.0f}", ["bright_background"]
        )
    if border > config.max_border:
        raise RefusedError(
            f"light on {border:.0%} of the border", [f"bright_background:{border:.2f}>{config.max_border:g}"]
        )
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((15, 15), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
    is_background = border > 0.05
    rows = [i for i in range(1, count) if not (is_background and _on_border(stats[i], closed.shape))]
    area = max((int(stats[i, 4]) for i in rows), default=0)
    if area < config.min_light * closed.size:
        raise RefusedError("no light of a body", [f"no_light:{area}px"])
    region = labels == max(rows, key=lambda i: stats[i, 4])
    points = np.argwhere(region & (mask > 0))[:, ::-1].astype(np.float32)
    (x, y), radius = cv2.minEnclosingCircle(points)
    centre_px = scale * (np.array([x, y]) + 0.5) - 0.5
    grown = cv2.dilate(region.astype(np.uint8), np.ones((9, 9), np.uint8))
    grown = cv2.resize(grown, image.shape[::-1], interpolation=cv2.INTER_NEAREST)
    signal = np.where(grown > 0, image.astype(np.float32) - background, 0.0).astype(np.float32)
    return BodyLight(signal, centre_px, 2.0 * scale * radius)


def _on_border(stats: IntArray, shape: tuple[int, ...]) -> bool:
    left, top, width, height = (int(v) for v in stats[:4])
    return left == 0 or top == 0 or left + width >= shape[1] or top + height >= shape[0]


class ImageSearch:
    """Search for one body in an image.

    Parameters
    ----------
    vertices_m : ndarray, shape (n, 3)
    triangles : ndarray of int64, shape (m, 3)
    centre_m : ndarray, shape (3,)
    diameter_m : float
    config : ImageSearchConfig
    """

    def __init__(
        self,
        vertices_m: FloatArray,
        triangles: IntArray,
        centre_m: FloatArray,
        diameter_m: float,
        config: ImageSearchConfig,
    ) -> None:
        self._vertices_m, self._triangles = vertices_m, triangles
        self._centre_m, self._diameter_m = centre_m, diameter_m
        self._config = config
        self._rotations = [
            se3.exp_so3([0.0, 0.0, 2.0 * math.pi * k / config.rolls]) @ view_rotation(d)
            for d in directions(config.views)
            for k in range(config.rolls)
        ]
        self._views = self._rendered_views()

    def find(self, light: BodyLight, camera: Window) -> list[ImageHypothesis]:
        """Return distinct poses, best first."""
        starts = self._starts(light, camera)
        window, fields, light_sum = _window_fields(light, camera, _FINE_PX, _FINE_EXTENT * light.extent_px)
        rng = np.random.default_rng(self._config.seed)
        found = [self._refined(T, window, fields, light_sum, 6, 8, 1.0, rng) for T in starts]
        best = self._distinct(found, 2 * self._config.hypotheses)
        found = [self._refined(h.T, window, fields, light_sum, 10, 14, 0.5, rng) for h in best]
        return self._distinct(found, self._config.hypotheses)

    def _starts(self, light: BodyLight, camera: Window) -> list[FloatArray]:
        """Return the poses whose renderings correlate best with the image, best first."""
        cfg, px = self._config, _COARSE_PX
        views = self._views
        results: list[tuple[float, int, float, FloatArray]] = []
        for size in np.geomspace(*_SIZES, _SIZE_STEPS):
            body_px = size * light.extent_px  # diameter of the body in the image
            _, fields, light_sum = _window_fields(light, camera, px, body_px * px / _COARSE_BODY_PX)
            spectrum = fft2(fields.edges)
            both = fft2((np.abs(fields.edges) ** 2 + 1j * fields.light).astype(np.complex64))
            for low in range(0, len(views.norms), _BATCH):
                part = slice(low, low + _BATCH)
                correlation = ifft2(spectrum * views.edges[part]).real
                sums = ifft2(both * views.seams[part])
                score = correlation / (views.norms[part, None, None] * np.sqrt(np.maximum(sums.real, 1.0)))
                score += _INSIDE * np.minimum(sums.imag / light_sum, 1.0 - _OUTSIDE)
                flat = score.reshape(len(score), -1)
                for i, k in enumerate(np.argmax(flat, axis=1)):
                    shift = np.array([k % px, k // px], np.float64)
                    shift -= px * (shift > px // 2)
                    results.append((float(flat[i, k]), low + i, float(size), shift))
        results.sort(key=lambda item: -item[0])
        starts: list[FloatArray] = []
        for _, i, size, shift in results:
            body_px = size * light.extent_px
            depth_m = camera.fx * self._diameter_m / body_px
            pixel = light.centre_px + shift * body_px / _COARSE_BODY_PX
            ray = np.array([(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0])
            # The rendered rotation is that relative to the line of sight.
            R = _towards(ray) @ self._rotations[i]
            T = se3.transform(R, depth_m * ray - R @ self._centre_m)
            if all(_angle(T, other) > math.radians(12.0) for other in starts):
                starts.append(T)
            if len(starts) == cfg.candidates:
                break
        return starts

    def _rendered_views(self) -> _Views:
        """Return the fields of the body from all sides, at the centre of a window."""
        px, focal = _COARSE_PX, _DISTANCE * _COARSE_BODY_PX
        window = Window(focal, focal, 0.5 * (px - 1), 0.5 * (px - 1), px, px)
        edges = np.empty((len(self._rotations), px, px), np.complex64)
        seams = np.empty_like(edges)
        norms = np.empty(len(edges), np.float32)
        for i, R in enumerate(self._rotations):
            T = se3.transform(R, np.array([0.0, 0.0, _DISTANCE * self._diameter_m]) - R @ self._centre_m)
            body = body_field(self._vertices_m, self._triangles, T, window)
            seam = cv2.dilate(body.mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
            field = body.edges * seam
            edges[i], seams[i] = np.conj(fft2(field)), np.conj(fft2(seam))
            norms[i] = math.sqrt(float(np.vdot(field, field).real)) + 1e-9
        return _Views(edges, seams, norms)

    def _refined(
        self,
        T: FloatArray,
        window: Window,
        fields: ImageField,
        light_sum: float,
        population: int,
        generations: int,
        spread: float,
        rng: np.random.Generator,
    ) -> ImageHypothesis:
        """Return the pose refined by CMA-ES."""
        terms: list[tuple[float, float, float]] = []

        def cost(points: FloatArray) -> FloatArray:
            values = []
            for point in points:
                body = body_field(self._vertices_m, self._triangles, self._moved(T, spread * point), window)
                terms.append(agreement(fields, body, light_sum))
                values.append(-_score(*terms[-1]))
            return np.array(values)

        _, points, values = minimise(
            cost, np.zeros(6), 1.0, population=population, generations=generations, rng=rng
        )
        k = int(np.argmin(values))
        return ImageHypothesis(self._moved(T, spread * points[k]), -float(values[k]), *terms[k])

    def _moved(self, T: FloatArray, point: FloatArray) -> FloatArray:
        """Return a pose rotated about the centre of the body and moved; ``point`` in units of ``_SPREAD``."""
        step = _SPREAD * point
        R = se3.exp_so3(step[:3]) @ T[:3, :3]
        centre = T[:3, :3] @ self._centre_m + T[:3, 3]
        centre = (centre + self._diameter_m * np.array([step[3], step[4], 0.0])) * math.exp(step[5])
        return se3.transform(R, centre - R @ self._centre_m)

    def _distinct(self, found: list[ImageHypothesis], count: int) -> list[ImageHypothesis]:
        """Return the best poses that differ by an angle."""
        kept: list[ImageHypothesis] = []
        for item in sorted(found, key=lambda h: -h.score):
            if all(_angle(item.T, other.T) > math.radians(self._config.distinct_deg) for other in kept):
                kept.append(item)
        return kept[:count]


def _score(edges: float, inside: float, shading: float) -> float:
    return edges + _INSIDE * min(inside, 1.0 - _OUTSIDE) + _SHADING * shading


def _window_fields(
    light: BodyLight, camera: Window, pixels: int, extent_px: float
) -> tuple[Window, ImageField, float]:
    """Return a square window around the light, its fields, and the sum of its light."""
    window, fields = window_field(light.signal, camera, light.centre_px, extent_px, pixels)
    return window, fields, float(fields.light.sum()) + 1e-9


def _towards(ray: FloatArray) -> FloatArray:
    """Return the smallest rotation (3, 3) from the optical axis to a ray."""
    z = ray / np.linalg.norm(ray)
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(axis))
    return np.eye(3) if sine < 1e-12 else se3.exp_so3(axis / sine * math.atan2(sine, float(z[2])))


def _angle(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between the rotations of two poses, rad."""
    return float(np.linalg.norm(se3.log_so3(first[:3, :3].T @ second[:3, :3])))
