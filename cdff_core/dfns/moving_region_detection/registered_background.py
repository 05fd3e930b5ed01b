# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Difference from a background that moves with the scene, in units of its uncertainty.

References
----------
.. [1] Piccardi, M. (2004). Background subtraction techniques: a review. IEEE SMC.
   doi:10.1109/ICSMC.2004.1400815
.. [2] Canny, J. (1986). A computational approach to edge detection, §VI (hysteresis). IEEE TPAMI 8(6).
   doi:10.1109/TPAMI.1986.4767851
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from pydantic import Field
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from cdff_common.arrays import BoolArray, Float32Array, FloatArray, IntArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.moving_region_detection.interface import Inputs, Interface, Outputs

#: Standard deviation of an image position without registration, pixels.
_SIGMA_PX = 0.05
#: Fraction of saturated or black pixels above which an image is refused.
_MAX_LOST = 0.5
#: Fraction of differing pixels above which the scene has changed.
_MAX_CHANGED = 0.3
#: Distance between the pixels from which noise and gain are estimated.
_STRIDE = 3
#: Gain with which the background learns a region, relative to that of other pixels, and number of images from
#: which the background of a pixel is known.
_REGION_GAIN, _KNOWN = 0.2, 4.0
#: Factor by which the image is reduced to measure slow changes of the brightness.
_SLOW = 16
#: Gain of one image in the noise model, number of images until the model is known, and largest ratio of the
#: difference of an image to the modelled noise.
_NOISE_GAIN, _NOISE_IMAGES, _MAX_NOISE = 0.3, 3, 4.0
#: Difference of a pixel of an object, relative to the largest difference of its region: dust and shadows
#: have less.
_STRONG_RATIO = 0.2
#: Factors on the mean of 3 x 3 values of z and on single values, which are compared with the threshold of a
#: region. With both, independent noise has a standard deviation of about 0.6: the mean of nine values has a
#: third of the standard deviation of one value.
_MEAN_FACTOR, _SINGLE_FACTOR = 1.7, 0.6
#: Largest gap between parts of one object, pixels.
_MAX_GAP_PX = 10.0
#: Difference of a thin structure from its surroundings, standard deviations of a pixel.
_THIN = 6.0
#: Brightness relative to the background below which a pixel may be in shadow; largest height of a column of
#: shadow relative to the object, and smallest fraction of its pixels that are dark.
_DARK, _SHADOW_HEIGHT, _SHADOW_RATIO = 0.8, 0.45, 0.5
#: Ratio of the gradient of the background to that of the image above which an object has left a pixel, and
#: side of the square over which the gradients are averaged, pixels.
_VACATED, _VACATED_PX = 2.0, 5


class RegisteredBackgroundConfig(DfnConfig):
    """Parameters of RegisteredBackground."""

    threshold: float = Field(5.0, gt=1.0, le=50.0, description="Difference of a region, standard deviations")
    low_threshold: float = Field(
        2.5,
        gt=0.5,
        le=50.0,
        description="Difference of the pixels that belong to a region, standard deviations",
    )
    min_area_px: float = Field(6.0, ge=1.0, le=1e4, description="Least area of a region, square pixels")
    max_side_px: float = Field(
        160.0,
        ge=4.0,
        le=1e4,
        description="Largest side of a region: larger ones are errors of the registration, px",
    )
    merge_gap: float = Field(
        0.35, ge=0.0, le=5.0, description="Gap between parts of one object, sides of the larger one"
    )
    memory: int = Field(12, ge=1, le=1000, description="Number of images that the background is the mean of")
    moving_memory: int = Field(
        4, ge=1, le=1000, description="The same while the camera moves: interpolation blurs the background"
    )


class RegisteredBackground(Interface[RegisteredBackgroundConfig]):
    """Running mean of the images [1]_, and regions by hysteresis [2]_.

    A pixel differs if its difference exceeds the noise, the error of the background, and the product of
    gradient and registration error.
    """

    def setup(self) -> None:
        """Clear the background."""
        self._mean: Float32Array | None = None
        self._count: Float32Array | None = None
        # Variance of a pixel of one image: constant and proportional to the brightness.
        self._noise_model = np.array([1.0, 0.01])
        self._images = 0

    def process(self, inputs: Inputs) -> Outputs:
        """Return the regions of one image.

        Raises
        ------
        InputError
            If the size of the image differs.
        RefusedError
            If the image is saturated or dark, or shows another scene.
        """
        raw = inputs.image
        if self._mean is not None and raw.shape != self._mean.shape:
            raise InputError(f"image {raw.shape}: expected the size of the previous ones, {self._mean.shape}")
        for reason, is_unusable in (("saturated", raw == 255), ("dark", raw <= 1)):
            if (fraction := float(is_unusable.mean())) > _MAX_LOST:
                raise RefusedError(
                    f"image: {fraction:.2f} of the pixels {reason}, expected at most {_MAX_LOST}",
                    reasons=[reason],
                )
        image = raw.astype(np.float32)
        if self._mean is None or self._count is None or inputs.places is None:
            self._mean, self._count = image, np.ones_like(image)
            return self._no_regions(image)
        mean, count = self._move_background(self._mean, self._count, inputs)
        gain = self._gain(image, mean)
        difference = image / np.float32(gain) - mean
        difference -= _slow_part(difference)
        gradient = _gradient(mean)
        self._learn_noise(mean, difference, gradient, count)
        shift = np.float32(_SIGMA_PX) if inputs.sigma is None else inputs.sigma
        usable = count > 0.0
        constant, slope = self._noise_model
        variance_of_one_image = constant + slope * mean
        variance = variance_of_one_image * (1.0 + 1.0 / np.maximum(count, 1.0)) + (gradient * shift) ** 2
        z = np.where(usable, difference / np.sqrt(variance), 0.0).astype(np.float32)
        regions, vacated = self._regions(z, difference, image / np.float32(gain), mean)
        learn = np.ones(image.shape, bool) if inputs.excluded is None else ~inputs.excluded
        fresh = count <= 0.0
        if inputs.replaced is not None:
            fresh |= inputs.replaced
        # A smooth object in front of rough ground has the same edges as ground that an object has left.
        fresh |= vacated if inputs.departed is None else vacated & ~inputs.departed
        # A region of a known background is learnt slowly.
        region_gain = np.where(count >= _KNOWN, np.float32(_REGION_GAIN), np.float32(0.0))
        gain_of_pixel = np.asarray(np.where(regions.labels > 0, region_gain, 1.0) * learn, np.float32)
        self._learn(mean + difference, mean, count, gain_of_pixel, fresh, inputs.is_at_rest)
        return regions

    def _move_background(
        self, mean: Float32Array, count: Float32Array, inputs: Inputs
    ) -> tuple[Float32Array, Float32Array]:
        """Return background and number of images of each pixel, in the current image."""
        if inputs.is_at_rest:
            return mean, count
        assert inputs.places is not None  # the caller has checked it
        u, v = inputs.places[..., 0].copy(), inputs.places[..., 1].copy()
        moved_mean = cv2.remap(mean, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        left = cv2.remap(count, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        return np.asarray(moved_mean, np.float32), np.minimum(left, self.config.moving_memory).astype(
            np.float32
        )

    @staticmethod
    def _gain(image: Float32Array, mean: Float32Array) -> float:
        a, b = image[::_STRIDE, ::_STRIDE], mean[::_STRIDE, ::_STRIDE]
        is_usable = (a > 4.0) & (a < 250.0) & (b > 4.0)
        return float(np.median(a[is_usable] / b[is_usable])) if is_usable.sum() > 100 else 1.0

    def _learn_noise(
        self, mean: Float32Array, difference: Float32Array, gradient: Float32Array, count: Float32Array
    ) -> None:
        """Fit constant and slope of the variance to the flat pixels in classes of brightness."""
        m, d, g, n = (x[::_STRIDE, ::_STRIDE].ravel() for x in (mean, difference, gradient, count))
        flat = (g <= np.median(g)) & (n > 0.0)
        m, d, n = m[flat], d[flat], n[flat]
        if len(m) < 200:
            return
        edges = np.quantile(m, np.linspace(0.0, 1.0, 7))
        part = np.clip(np.searchsorted(edges, m, side="right") - 1, 0, 5)
        scaled = np.abs(d) / np.sqrt(1.0 + 1.0 / n)
        populated_parts = [k for k in range(6) if (part == k).sum() >= 30]
        brightness = np.array([m[part == k].mean() for k in populated_parts])
        variance = np.array([(1.4826 * np.median(scaled[part == k])) ** 2 for k in populated_parts])
        slope = 0.0
        if len(populated_parts) >= 2 and np.ptp(brightness) > 10.0:
            slope = max(float(np.polyfit(brightness, variance, 1)[0]), 0.0)
        constant = max(float(np.median(variance - slope * brightness)), 0.1)
        before = float(np.sqrt(self._noise_model @ np.array([1.0, brightness.mean()])))
        ratio = float(np.sqrt(variance.mean())) / before
        self._images += 1
        if self._images > _NOISE_IMAGES and ratio > _MAX_NOISE:
            self._mean = None
            raise RefusedError(
                f"image: difference from the background {ratio:.1f} times the noise,"
                f" expected at most {_MAX_NOISE}",
                reasons=["scene_changed"],
            )
        self._noise_model = self._noise_model + _NOISE_GAIN * (
            np.array([constant, slope]) - self._noise_model
        )

    def _noise_at(self, mean: Float32Array) -> float:
        brightness = float(mean[::_STRIDE, ::_STRIDE].mean())
        return float(np.sqrt(self._noise_model @ np.array([1.0, brightness])))

    def _regions(
        self, z: Float32Array, difference: Float32Array, image: Float32Array, mean: Float32Array
    ) -> tuple[Outputs, BoolArray]:
        """Return the regions above the low threshold that reach the high one, and the vacated pixels."""
        c = self.config
        strength = np.abs(cv2.blur(z, (3, 3))) * np.float32(_MEAN_FACTOR)
        low = ((np.abs(z) > c.low_threshold) | (strength > c.low_threshold)).astype(np.uint8)
        if float(low.mean()) > _MAX_CHANGED:
            self._mean = None
            raise RefusedError(
                f"image: {float(low.mean()):.2f} of the pixels differ from the background,"
                f" expected at most {_MAX_CHANGED}",
                reasons=["scene_changed"],
            )
        low = np.asarray(cv2.morphologyEx(low, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)), np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(low, connectivity=8)
        peak = np.zeros(count, np.float32)
        np.maximum.at(
            peak,
            np.asarray(labels, np.int64)[low > 0],
            np.maximum(strength, np.abs(z) * np.float32(_SINGLE_FACTOR))[low > 0],
        )
        labels_above_threshold = np.flatnonzero(
            (peak > c.threshold) & (stats[:, cv2.CC_STAT_AREA] >= c.min_area_px)
        )
        labels_above_threshold = labels_above_threshold[labels_above_threshold > 0]
        vacated = _vacated_pixels(low > 0, image, mean, self._noise_at(mean))
        part_labels = np.zeros(image.shape, np.int64)
        peaks: list[float] = []
        for k in labels_above_threshold:
            u, v, w, h, _ = stats[k]
            # Morphology at the border of a window would extend the region to it.
            window = (slice(max(v - 3, 0), v + h + 3), slice(max(u - 3, 0), u + w + 3))
            inside = (labels[window] == k) & ~vacated[window]
            if not inside.any():
                continue
            for mask in _parts(inside, difference[window], z[window]):
                peaks.append(float(peak[k]))
                label = len(peaks)  # labels start at 1
                part_labels[window][mask] = label
        group_labels, groups = _merge_parts(part_labels, len(peaks), self.config.merge_gap)
        region_labels = np.zeros(image.shape, np.int32)
        shapes, sharp, significances = [], [], []
        for number, members in enumerate(groups, 1):
            rows, cols = np.nonzero(group_labels == number)
            side = max(np.ptp(rows), np.ptp(cols)) + 1
            if len(rows) < c.min_area_px or side > c.max_side_px:
                continue
            window = (
                slice(max(rows.min() - 2, 0), rows.max() + 3),
                slice(max(cols.min() - 2, 0), cols.max() + 3),
            )
            mask = _without_shadow(group_labels[window] == number, image[window] < _DARK * mean[window])
            offset = np.array([window[1].start, window[0].start], float)
            shape = _shape(mask, difference[window], offset)
            # Vacated pixels next to a region make its border uncertain.
            around = vacated[window] & ~mask
            blur = float(around.sum()) / shape.area * np.ptp(shape.box.reshape(2, 2), axis=1)
            shapes.append(replace(shape, covariance=shape.covariance + np.diag((0.3 * blur) ** 2)))
            sharp.append(_sharpness(mask, difference[window]))
            significances.append(max(peaks[m] for m in members))
            region_labels[window][mask] = len(shapes)
        regions = Outputs(
            boxes=np.array([s.box for s in shapes]).reshape(-1, 4),
            centroids=np.array([s.centroid for s in shapes]).reshape(-1, 2),
            covariances=np.array([s.covariance for s in shapes]).reshape(-1, 2, 2),
            areas=np.array([s.area for s in shapes], float),
            significances=np.array(significances, float),
            sharpness=np.array(sharp, float),
            labels=region_labels,
            noise=self._noise_at(mean),
        )
        return regions, vacated

    def _learn(
        self,
        image: Float32Array,
        mean: Float32Array,
        count: Float32Array,
        gain: Float32Array,
        fresh: BoolArray,
        is_at_rest: bool,
    ) -> None:
        """Update the background with the gain (r, c) of each pixel; it adopts
        the ``fresh`` pixels at once.
        """
        memory = self.config.memory if is_at_rest else self.config.moving_memory
        n = np.minimum(count + 1.0, memory)
        updated = mean + gain * (image - mean) / n
        new_count = np.where(gain > 0.0, n, count)
        self._mean = np.where(fresh, image, updated).astype(np.float32)
        self._count = np.where(fresh, 1.0, new_count).astype(np.float32)

    def _no_regions(self, image: Float32Array) -> Outputs:
        """Return the outputs of an image without regions."""
        return Outputs(
            boxes=np.zeros((0, 4)),
            centroids=np.zeros((0, 2)),
            covariances=np.zeros((0, 2, 2)),
            areas=np.zeros(0),
            significances=np.zeros(0),
            sharpness=np.zeros(0),
            labels=np.zeros(image.shape, np.int32),
            noise=self._noise_at(image),
        )


def _gradient(image: Float32Array) -> Float32Array:
    """Return the magnitude of the gradient, grey levels per pixel."""
    u, v = (cv2.Sobel(image, cv2.CV_32F, *axis) for axis in ((1, 0), (0, 1)))
    return np.asarray(cv2.magnitude(u, v) / 8, np.float32)


def _slow_part(difference: Float32Array) -> Float32Array:
    """Return the part of a difference that changes over many pixels: light, vignetting, haze."""
    rows, cols = difference.shape
    size = (max(cols // _SLOW, 1), max(rows // _SLOW, 1))
    small = cv2.medianBlur(cv2.resize(difference, size, interpolation=cv2.INTER_AREA), 5)
    return np.asarray(cv2.resize(small, (cols, rows), interpolation=cv2.INTER_LINEAR), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """Shape of a region in the image: centroid (2,), its covariance (2, 2), area and box (4,)."""

    centroid: FloatArray
    covariance: FloatArray
    area: float
    box: FloatArray


def _parts(inside: BoolArray, difference: Float32Array, z: Float32Array) -> list[BoolArray]:
    """Return the masks of the parts of a region that differ most; weaker pixels are dust or penumbra."""
    d = np.where(inside, difference, np.float32(0.0))
    strength = np.abs(cv2.blur(d, (3, 3)))
    # The level of the largest differences, without single pixels.
    level = float(np.percentile(strength[inside], 98.0))
    # Thin parts, such as a mast, have less contrast than dust, which is smooth.
    kernel = np.ones((5, 5), np.uint8)
    thin = np.maximum(*(cv2.morphologyEx(x, cv2.MORPH_TOPHAT, kernel) for x in (z, -z))) > _THIN
    strong = (inside & (np.abs(d) > _STRONG_RATIO * level)).astype(np.uint8)
    strong |= (inside & thin & (cv2.dilate(strong, np.ones((3, 3), np.uint8)) == 0)).astype(np.uint8)
    strong = np.asarray(cv2.morphologyEx(strong, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)), np.uint8)
    count, labels = cv2.connectedComponents(strong, connectivity=8)
    return [labels == k for k in range(1, count)]


def _merge_parts(part_labels: IntArray, count: int, gap: float) -> tuple[IntArray, list[list[int]]]:
    """Group the parts of one object; return the group label of each pixel, 0 outside, and the parts of each
    group.

    ``part_labels`` (r, c) contains the labels 1 to ``count``. Parts, such as the head of a mast and the body
    below it, belong together if the gap between their boxes is below ``gap`` times the side of the larger
    one.
    """
    boxes = np.zeros((count, 4))
    for k in range(count):
        rows, cols = np.nonzero(part_labels == k + 1)
        boxes[k] = cols.min(), cols.max() + 1, rows.min(), rows.max() + 1
    side = np.maximum(boxes[:, 1] - boxes[:, 0], boxes[:, 3] - boxes[:, 2])
    gaps = np.zeros((count, count))
    for low, high in ((0, 1), (2, 3)):
        gap_along_axis = np.maximum(
            boxes[:, None, low] - boxes[:, high], boxes[:, low] - boxes[:, None, high]
        )
        gaps = np.maximum(gaps, gap_along_axis)
    is_near = gaps <= np.clip(gap * np.maximum(side[:, None], side), 1.5, _MAX_GAP_PX)
    _, group = connected_components(csr_matrix(is_near), directed=False)
    number = np.concatenate([[0], group + 1]).astype(np.int64)
    members: list[list[int]] = [[] for _ in range(int(group.max(initial=-1)) + 1)]
    for k, g in enumerate(group):
        members[g].append(k)
    return number[part_labels], members


def _without_shadow(mask: BoolArray, dark: BoolArray) -> BoolArray:
    """Return a region without the low dark columns at its left and right: the shadow on the ground.

    Seen from a low camera, the shadow of an object is a low strip next to it.
    """
    count = mask.sum(axis=0)
    # A mast is higher than the body.
    is_shadow = count <= _SHADOW_HEIGHT * float(np.percentile(count[count > 0], 75.0))
    is_shadow &= (mask & dark).sum(axis=0) >= _SHADOW_RATIO * count
    keep = np.flatnonzero(~is_shadow & (count > 0))
    if len(keep) == 0:
        return mask
    result = mask.copy()
    result[:, : keep[0]] = False
    result[:, keep[-1] + 1 :] = False
    return result


def _vacated_pixels(differs: BoolArray, image: Float32Array, mean: Float32Array, noise: float) -> BoolArray:
    """Return the differing pixels that an object of the background has left.

    The border of the area that the object has left is an edge of the background; the border of its new area
    is an edge of the image. Each differing pixel is classified like the nearest pixel of the border.
    """
    mask = differs.astype(np.uint8)
    border = differs & (cv2.erode(mask, np.ones((3, 3), np.uint8)) == 0)
    gained, lost = _gradient(image), _gradient(mean)
    size = (_VACATED_PX, _VACATED_PX)
    gain_of_edges = cv2.blur(np.maximum(gained - lost, 0.0), size)
    loss_of_edges = cv2.blur(np.maximum(lost - gained, 0.0), size)
    is_old: BoolArray = border & (loss_of_edges > _VACATED * gain_of_edges + 0.5 * noise)
    if not is_old.any():
        return is_old
    _, nearest = cv2.distanceTransformWithLabels(
        (~border).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_old = np.zeros(int(nearest.max()) + 1, bool)
    of_old[nearest[is_old]] = True
    return np.asarray(differs & of_old[nearest])


def _sharpness(mask: BoolArray, difference: Float32Array) -> float:
    """Return the ratio of the largest gradient of the difference, in and around a region, to its largest
    value.
    """
    is_near_mask = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    d = cv2.GaussianBlur(difference, (3, 3), 0)
    gradient = cv2.magnitude(cv2.Sobel(d, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(d, cv2.CV_32F, 0, 1) / 8)
    return float(np.percentile(gradient[is_near_mask], 95.0) / max(float(np.abs(d[mask]).max()), 1e-6))


def _shape(mask: BoolArray, difference: Float32Array, offset: FloatArray) -> _Shape:
    """Return the shape of a region; ``offset`` (2,) is the first column and row of its window, pixels.

    The weight of a pixel of the edge is the part of it that the object covers: its difference divided by the
    largest one of its neighbours.
    """
    strength = np.abs(difference)
    filled_mask = _fill_holes(mask)
    inner = cv2.erode(filled_mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    local = cv2.dilate(np.where(filled_mask, strength, np.float32(0.0)), np.ones((3, 3), np.uint8))
    part = np.clip(strength / np.maximum(local, 1e-3), 0.0, 1.0)
    weight = np.where(inner, 1.0, np.where(filled_mask, part, 0.0))
    area = float(weight.sum())
    v, u = np.mgrid[0 : mask.shape[0], 0 : mask.shape[1]]
    centroid = np.array([float((weight * u).sum()), float((weight * v).sum())]) / area
    # The object covers an unknown part, from 0 to 1, of each pixel of the edge: its variance is 1/12.
    edge = filled_mask & ~inner
    du, dv = u[edge] - centroid[0], v[edge] - centroid[1]
    moments = np.array([[float(du @ du), float(du @ dv)], [float(du @ dv), float(dv @ dv)]])
    covariance = moments / 12.0 / area**2 + 0.02**2 * np.eye(2)
    rows, cols = strength.shape
    box = np.array(
        [
            cols - 1 - _last_edge(filled_mask[:, ::-1].T, strength[:, ::-1].T),
            _last_edge(filled_mask.T, strength.T),
            rows - 1 - _last_edge(filled_mask[::-1], strength[::-1]),
            _last_edge(filled_mask, strength),
        ]
    )
    return _Shape(centroid + offset, covariance, area, box + np.repeat(offset, 2))


def _last_edge(mask: BoolArray, strength: Float32Array) -> float:
    """Return the sub-pixel row at which a region ends: there the difference is half of that of its last full
    rows.
    """
    last = int(np.flatnonzero(mask.any(axis=1))[-1])
    first = max(last - 3, 0)
    is_edge_column = mask[max(last - 1, 0) : last + 1].any(axis=0)
    profile = strength[first : last + 2, is_edge_column].mean(axis=1)
    level = 0.5 * float(profile.max())
    above = int(np.flatnonzero(profile >= level)[-1])
    if above + 1 >= len(profile):
        return first + above + 0.5
    step = float(profile[above] - profile[above + 1])
    return first + above + float((profile[above] - level) / max(step, 1e-6))


def _fill_holes(mask: BoolArray) -> BoolArray:
    """Fill the holes of a mask: pixels that have mask pixels on both sides in
    their row and in their column.
    """
    across = np.logical_or.accumulate(mask, axis=1) & np.logical_or.accumulate(mask[:, ::-1], axis=1)[:, ::-1]
    along = np.logical_or.accumulate(mask, axis=0) & np.logical_or.accumulate(mask[::-1], axis=0)[::-1]
    return np.asarray(mask | (across & along))
