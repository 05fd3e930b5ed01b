# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Range by comparison of the image with the rendered model."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.apparent_size_ranging.interface import Inputs, Interface, Outputs
from cdff_core.dfns.apparent_size_ranging.similarity import Similarity, register_similarity
from cdff_core.object_models.lit_body import lit_body
from cdff_core.object_models.rendering import Window

#: Levels of brightness, relative to the median, at which the certain and the possible outline are drawn.
_OUTLINES = (0.5, 0.15)
#: Lit fraction of the apparent size: assumed if the direction of the Sun is unknown, and lower bound for a
#: known direction.
_LIT_UNKNOWN, _LIT_LEAST = 0.5, 0.3
#: Area of the pixels whose residuals are not independent, in units of the point spread's variance.
_CORRELATED = 4.0 * np.pi
#: Number of renderings, each at the range and position of the previous comparison.
_RENDERINGS = 3
#: Brightness relative to the maximum below which light belongs to haze, dust or the wings of the point
#: spread.
_HAZE = 0.1
#: Relative error of the extent of the light, which depends on the level at which the outline is drawn.
_OUTLINE_ERROR = 0.03


class RenderedComparisonConfig(DfnConfig):
    """Parameters of RenderedComparison."""

    min_extent_px: float = Field(
        5.0, ge=2.0, le=1000.0, description="Extent of the light below which the body is unresolved, px"
    )
    min_agreement: float = Field(
        0.8, ge=0.0, le=1.0, description="Correlation of image and rendered model below which it is refused"
    )
    model_error: float = Field(
        0.01,
        ge=0.0,
        le=0.5,
        description="Error of the range by the reflectance and the size of the model, relative",
    )
    compression: float = Field(
        10.0,
        gt=0.1,
        le=1e6,
        description="Brightness that is compressed to a half, in medians of the light: limits reflections",
    )
    edge_error_px: float = Field(
        0.25, ge=0.0, le=10.0, description="Error of an edge by shading and point spread, px"
    )
    unresolved_px: float = Field(
        4.5,
        ge=0.0,
        le=100.0,
        description="Extent of the light at which parts of different reflectance make the size uncertain by"
        " itself, px; the relative error decreases with the square of the extent",
    )


class RenderedComparison(Interface[RenderedComparisonConfig]):
    """The model is rendered with its attitude, the Sun and the shadows; scale and shift of the image relative
    to the rendering are those of a least-squares registration.

    The brightness is compressed by ``L / (L + k median)``, which limits specular reflections; a smaller ``k``
    moves the terminator of rough surfaces. Without attitude or Sun the range is an interval: the extent of
    the light is at most the largest apparent size, and at least the lit part of the smallest one.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the range of the body.

        Raises
        ------
        InputError
            If the sizes are not in order, or the model is incomplete.
        RefusedError
            If the body is not resolved, or the image disagrees with the rendered model.
        """
        image = np.ascontiguousarray(inputs.image, np.float32)
        if not 0.0 < inputs.sizes[0] <= inputs.sizes[1]:
            raise InputError(
                f"sizes={inputs.sizes.tolist()}: expected the smallest and the largest, positive"
            )
        level = _level(image, inputs.noise)
        extents = [_extent_px(image > max(part * level, 4.0 * inputs.noise)) for part in _OUTLINES]
        if extents[0] < self.config.min_extent_px:
            raise RefusedError(
                f"image: the light extends over {extents[0]:.1f} px, expected at least"
                f" {self.config.min_extent_px:g} px",
                reasons=[f"unresolved:{extents[0]:.1f}px<{self.config.min_extent_px:g}px"],
            )
        interval = self._interval(inputs, extents)
        if inputs.attitude is None or inputs.sun is None or inputs.vertices is None:
            return Outputs(
                range=float(interval.mean()),
                range_sigma=float(np.ptp(interval) / np.sqrt(12.0)),
                interval=interval,
                origin=np.full(2, np.nan),
                agreement=float("nan"),
                extent=extents[0],
            )
        if inputs.triangles is None:
            raise InputError(f"triangles: None, expected those of {len(inputs.vertices)} vertices")
        return self._compare_scale(inputs, image, level, extents[0], interval)

    def _interval(self, inputs: Inputs, extents: list[float]) -> FloatArray:
        """Return the ranges (2,) at which some attitude has the extent of the light."""
        part = _LIT_UNKNOWN
        if inputs.sun is not None:
            # The lit part of a sphere at this phase angle.
            part = max(0.5 * (1.0 - float(inputs.sun[2])), _LIT_LEAST)
        # An extent has an error of a pixel, in addition to that of the outline.
        nearest = part * inputs.focal * inputs.sizes[0] / ((1.0 + _OUTLINE_ERROR) * extents[1] + 1.0)
        farthest = inputs.focal * inputs.sizes[1] / ((1.0 - _OUTLINE_ERROR) * extents[0] - 1.0)
        return np.array([nearest, farthest])

    def _compare_scale(
        self, inputs: Inputs, image: Float32Array, level: float, extent_px: float, interval: FloatArray
    ) -> Outputs:
        """Return the range at which rendering and image agree best; raises RefusedError if they disagree."""
        target = _compress_brightness(image, self.config.compression * level)
        rows, columns = image.shape
        origin = np.array([0.5 * (columns - 1), 0.5 * (rows - 1)])
        range_m = inputs.focal * float(inputs.sizes[1]) / extent_px
        template = self._render_at(inputs, range_m, origin, image.shape, extent_px)
        if not template.any():
            raise _disagreement(0.0, self.config.min_agreement)
        # The first range and position give the light of the rendering the radius and centre of the light of
        # the image.
        (light_centre, radius), (model_light_centre, model_radius) = _moments(target), _moments(template)
        range_m *= model_radius / max(radius, 1e-6)
        origin = origin + light_centre - model_light_centre
        blurs: tuple[float, ...] = (max(0.06 * extent_px, 1.0), max(0.02 * extent_px, 0.6), 0.0)
        for _ in range(_RENDERINGS):
            template = self._render_at(inputs, range_m, origin, image.shape, extent_px)
            similarity: Similarity = register_similarity(target, template, origin, blurs)
            range_m, origin = range_m / similarity.scale, origin + similarity.shift_px
            blurs = blurs[-1:]
        if not similarity.agreement >= self.config.min_agreement:
            raise _disagreement(similarity.agreement, self.config.min_agreement)
        formal = similarity.scale_sigma * np.sqrt(_CORRELATED * max(inputs.point_spread**2, 0.1))
        edge = np.sqrt(2.0) * self.config.edge_error_px / extent_px
        unresolved = (self.config.unresolved_px / extent_px) ** 2
        sigma = range_m * float(np.sqrt(formal**2 + edge**2 + unresolved**2 + self.config.model_error**2))
        return Outputs(
            range=range_m,
            range_sigma=sigma,
            interval=interval,
            origin=origin,
            agreement=similarity.agreement,
            extent=extent_px,
        )

    def _render_at(
        self, inputs: Inputs, range_m: float, origin: FloatArray, shape: tuple[int, ...], extent_px: float
    ) -> Float32Array:
        """Return the compressed rendering (r, c) with the origin of the body at a pixel."""
        assert inputs.vertices is not None
        assert inputs.triangles is not None
        assert inputs.attitude is not None
        assert inputs.sun is not None
        middle = 0.5 * (np.array([shape[1], shape[0]]) - 1.0)
        ray = np.append((origin - middle) / inputs.focal, 1.0)
        window = Window(inputs.focal, inputs.focal, float(middle[0]), float(middle[1]), shape[0], shape[1])
        light = lit_body(
            inputs.vertices,
            inputs.triangles,
            se3.transform(inputs.attitude, range_m * ray / np.linalg.norm(ray)),
            window,
            inputs.sun,
            point_spread_px=inputs.point_spread,
            extent_px=extent_px,
        )
        return _compress_brightness(light, self.config.compression * _level(light, 1e-3))


def _level(image: Float32Array, noise: float) -> float:
    """Return the median brightness of the light, without haze around the body."""
    light = image[image > 5.0 * noise]
    if len(light) == 0:
        return 5.0 * noise
    return float(np.median(light[light > _HAZE * np.percentile(light, 98.0)]))


def _compress_brightness(image: Float32Array, level: float) -> Float32Array:
    """Return ``L / (L + level)``."""
    positive = np.maximum(image, 0.0)
    return np.asarray(positive / (positive + level), np.float32)


def _extent_px(mask: np.ndarray) -> float:
    """Return the largest distance of two pixels of the largest connected part of a mask, with their width."""
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(
        cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    )
    if count < 2:
        return 0.0
    largest = 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    points = cv2.findNonZero((mask & (labels == largest)).astype(np.uint8))
    hull = cv2.convexHull(points).reshape(-1, 2).astype(float)
    return float(np.linalg.norm(hull[:, None] - hull, axis=2).max()) + 1.0


def _moments(image: Float32Array) -> tuple[FloatArray, float]:
    """Return centre (2,), column and row, and root mean square radius of the light."""
    rows, columns = np.nonzero(image > 0.2 * image.max())
    weights = image[rows, columns].astype(float)
    points = np.column_stack([columns, rows])
    centre = np.average(points, axis=0, weights=weights)
    radius = np.sqrt(np.average(((points - centre) ** 2).sum(axis=1), weights=weights))
    return np.asarray(centre), float(radius)


def _disagreement(value: float, limit: float) -> RefusedError:
    return RefusedError(
        f"image: correlation {value:.2f} with the rendered model, expected at least {limit:g}; the"
        " attitude, the Sun or the model is wrong, or another body is seen",
        reasons=[f"model_disagrees:{value:.2f}<{limit:g}"],
    )
