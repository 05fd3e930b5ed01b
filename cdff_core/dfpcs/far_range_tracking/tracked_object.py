# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One tracked object: motion, size and appearance."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.types import ObjectTrackStatusT
from cdff_core.bearing_tracking.motion import BearingStates
from cdff_core.dfpcs.far_range_tracking.range_filter import RangeFilter

#: Pixels around an object that belong to its appearance: its edge.
_EDGE_PX = 2
#: Gains of the running means: of the size if the new size is larger or smaller, and of the appearance.
_GROWTH_GAIN, _SHRINK_GAIN, _APPEARANCE_GAIN = 0.15, 0.07, 0.2
#: Gains of the size while the appearance shows that no part is hidden: dust and shadows only enlarge it.
_CLEAR_GROWTH_GAIN, _CLEAR_SHRINK_GAIN = 0.05, 0.2
#: Standard deviations of the offset between the position of the appearance and that of the object: growth
#: from image to image, value after the appearance has been replaced, and value without an estimate, pixels.
_ANCHOR_DRIFT_PX, _ANCHOR_NEW_PX, _ANCHOR_UNKNOWN_PX = 0.03, 0.5, 5.0
#: Correlation relative to the usual one above which no part of the object is hidden.
_FULL_VIEW = 0.9
#: Difference between the motions of two edges from which one of them is that of an occluder, pixels.
_EDGE_MOVED_PX = 2.0
#: Change of scale from which the stored appearance is replaced.
_NEW_SCALE = 1.15


@dataclass(slots=True, eq=False)
class Appearance:
    """Grey levels of an object.

    Attributes
    ----------
    template, weights : ndarray (h, w)
    offset : ndarray (2,)
        Position of the object relative to the middle of the template, pixels.
    size_px : ndarray (2,)
        Width and height of the object in the template.
    """

    template: Float32Array
    weights: Float32Array
    offset: FloatArray
    size_px: FloatArray

    @classmethod
    def cut(
        cls, image: np.ndarray, mask: np.ndarray, box: FloatArray, position_px: FloatArray
    ) -> Appearance | None:
        """Return the appearance of the pixels of a mask (r, c) in a box; None at the border of the image."""
        rows, cols = image.shape
        u0, u1 = int(np.floor(box[0])) - _EDGE_PX, int(np.ceil(box[1])) + _EDGE_PX + 1
        v0, v1 = int(np.floor(box[2])) - _EDGE_PX, int(np.ceil(box[3])) + _EDGE_PX + 1
        if u0 < 0 or v0 < 0 or u1 > cols or v1 > rows:
            return None
        window = (slice(v0, v1), slice(u0, u1))
        weights = cv2.dilate(mask[window].astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
        if not weights.any():
            return None
        middle = np.array([0.5 * (u0 + u1 - 1), 0.5 * (v0 + v1 - 1)])
        size = np.array([box[1] - box[0], box[3] - box[2]])
        return cls(image[window].astype(np.float32), weights, position_px - middle, np.maximum(size, 1.0))

    def blended(self, newer: Appearance, shift: FloatArray) -> Appearance:
        """Return the appearance with a part of a newer one, which is ``shift`` (2,) pixels to the right and
        below.
        """
        h, w = self.template.shape
        M = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        warped_template = cv2.warpAffine(
            newer.template, M, (w, h), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        warped_weights = cv2.warpAffine(newer.weights, M, (w, h), flags=flags)
        part = np.float32(_APPEARANCE_GAIN) * np.minimum(warped_weights, 1.0)
        template = self.template + part * (warped_template - self.template)
        weights = self.weights + np.float32(_APPEARANCE_GAIN) * (warped_weights - self.weights)
        return Appearance(
            np.asarray(template, np.float32), np.asarray(weights, np.float32), self.offset, self.size_px
        )


@dataclass(slots=True, eq=False)
class TrackedObject:
    """State of one object.

    Attributes
    ----------
    number : int
        0 until the object is confirmed.
    states, clear_states : BearingStates
        State from all images, and from those in which no part of the object was hidden; one object each.
    size_px : ndarray (2,)
        Width and height.
    start : ndarray (3,)
        First direction.
    parallax_rad : float
        Path relative to the scene that the parallax of an object at rest can explain.
    pixel, pixel_covariance : ndarray (2,), (2, 2)
        In the last image; NaN without a measurement.
    box, first_box : ndarray (4,)
        First and last column and row in the last image, and in the first one; NaN without a region.
    region : int
        Region of the last image; -1 for none.
    is_whole, is_full_height : bool
        True if the region of the last image shows the whole object, or its lowest and highest points.
    centre : ndarray (2,)
        Mean offset of the centroid from the middle of the box, relative to the size.
    checked : ndarray (3,)
        Direction at the last test for rest.
    has_departed : bool
        True if it has moved by more than its size since the start.
    usual_score : float
        Mean correlation of the appearance in the images of the whole object.
    """

    number: int
    states: BearingStates
    size_px: FloatArray
    start: FloatArray
    appearance: Appearance | None
    first_ns: int
    seen_ns: int
    label: str = ""
    is_designated: bool = False
    hits: int = 1
    misses: int = 0
    unlike: int = 0
    usual_score: float = 0.8
    anchor_variance: float = _ANCHOR_UNKNOWN_PX**2
    centre: FloatArray = field(default_factory=lambda: np.zeros(2))
    parallax_rad: float = 0.0
    score: float = 1.0
    pixel: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    pixel_covariance: FloatArray = field(default_factory=lambda: np.full((2, 2), np.nan))
    box: FloatArray = field(default_factory=lambda: np.full(4, np.nan))
    first_box: FloatArray = field(default_factory=lambda: np.full(4, np.nan))
    region: int = -1
    is_whole: bool = False
    is_full_height: bool = False
    checked: FloatArray = field(default_factory=lambda: np.zeros(3))
    has_departed: bool = False
    range: RangeFilter = field(default_factory=RangeFilter)
    range_reasons: tuple[str, ...] = ()
    range_inputs: tuple[str, ...] = ()
    status: ObjectTrackStatusT = ObjectTrackStatusT.TRACK_TENTATIVE
    clear_states: BearingStates = field(init=False)

    def __post_init__(self) -> None:
        """Start both states with the same one."""
        self.clear_states = self.states

    @property
    def is_confirmed(self) -> bool:
        """True if the object has a number."""
        return self.number > 0

    @property
    def direction(self) -> FloatArray:
        """Unit vector (3,)."""
        return np.asarray(self.states.directions[0])

    def allow_move(self, distance_rad: float) -> None:
        """Increase the variance of the direction, radians, before another point of the object measures it."""
        covariances = self.states.covariances.copy()
        covariances[:, :3, :3] += distance_rad**2 * np.eye(3)
        self.states = BearingStates(self.states.directions, self.states.rates, covariances)
        self.anchor_variance = _ANCHOR_UNKNOWN_PX**2

    def adopt(
        self, appearance: Appearance | None, middle: FloatArray | None, position_px: FloatArray
    ) -> None:
        """Add the appearance of the object at an image position (2,).

        ``middle`` is the image position at which the middle of the stored template was matched; None without
        a match.
        """
        if appearance is None:
            return
        previous_appearance = self.appearance
        ratio = (
            1.0
            if previous_appearance is None
            else float(np.max(appearance.size_px / previous_appearance.size_px))
        )
        if previous_appearance is None or middle is None or not 1.0 / _NEW_SCALE < ratio < _NEW_SCALE:
            self.appearance = appearance
            self.anchor_variance = max(self.anchor_variance, _ANCHOR_NEW_PX**2)
            return
        newer_middle = position_px - appearance.offset
        first_old = middle - 0.5 * (np.array(previous_appearance.template.shape[::-1]) - 1.0)
        first_new = newer_middle - 0.5 * (np.array(appearance.template.shape[::-1]) - 1.0)
        self.appearance = previous_appearance.blended(appearance, first_old - first_new)

    def anchored(
        self,
        match_px: FloatArray,
        match_covariance: FloatArray,
        position_px: FloatArray,
        covariance: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the image position (2,) of the object and its covariance (2, 2) from appearance and region.

        The appearance measures the motion well, but its position drifts; the region measures the position
        with the noise of its edges. The offset between the two positions is averaged.
        """
        variance = self.anchor_variance + _ANCHOR_DRIFT_PX**2
        gain = variance / (variance + 0.5 * float(np.trace(covariance)))
        self.anchor_variance = (1.0 - gain) * variance
        shift = gain * (position_px - match_px)
        if self.appearance is not None:
            a = self.appearance
            self.appearance = Appearance(a.template, a.weights, a.offset + shift, a.size_px)
        return match_px + shift, match_covariance + self.anchor_variance * np.eye(2)

    def resize(self, size_px: FloatArray, *, is_clear: bool = False) -> None:
        """Move the stored size towards a new one.

        It decreases slowly, as a hidden part makes it smaller, unless the object ``is_clear``, in full view:
        then it grows slowly, as dust and shadows make it larger.
        """
        ratio = np.log(np.maximum(size_px, 1.0) / self.size_px)
        gains = (_CLEAR_GROWTH_GAIN, _CLEAR_SHRINK_GAIN) if is_clear else (_GROWTH_GAIN, _SHRINK_GAIN)
        gain = np.maximum(np.where(ratio > 0.0, *gains), 1.0 / (1.0 + self.hits))
        self.size_px = self.size_px * np.exp(gain * ratio)

    def is_next_to(self, box: FloatArray) -> bool:
        """Return whether the object, if it is seen in the last image, is in, or next to, a box (4,)."""
        if not np.isfinite(self.pixel).all():
            return False
        half = 0.5 * self.size_px + 2.0
        low, high = self.pixel - half, self.pixel + half
        return bool(box[0] < high[0] and box[1] > low[0] and box[2] < high[1] and box[3] > low[1])

    def is_similar_height(self, height_px: float) -> bool:
        """Return whether a height is that of the whole object, within 8 % and about half a pixel."""
        change = abs(float(np.log(max(height_px, 0.5) / self.size_px[1])))
        return change < 0.08 + 0.6 / float(self.size_px[1])

    def is_in_full_view(self, score: float) -> bool:
        """Return whether a correlation of the appearance is that of the object without a hidden part."""
        return score > _FULL_VIEW * self.usual_score

    def learn_score(self, score: float) -> None:
        """Update the usual correlation with that of an image of the whole object."""
        self.usual_score += 0.2 * (score - self.usual_score)

    def learn_centre(self, centroid: FloatArray) -> None:
        """Update the mean offset of the centroid from the middle of the box, relative to the size."""
        middle = np.array([self.box[0] + self.box[1], self.box[2] + self.box[3]]) / 2.0
        self.centre += 0.1 * ((centroid - middle) / self.size_px - self.centre)

    def whole_middle(self, size_px: FloatArray, expected: FloatArray) -> FloatArray:
        """Return the middle (2,) of the whole object, of which this one is the part that comes into view.

        Of two opposite edges, the one that has moved less since the first image is that of the occluder; the
        whole object, with a size (2,), extends from the other one. Axes without a difference have the
        ``expected`` value.
        """
        result = np.array(expected, float)
        for axis, (low, high) in enumerate(((0, 1), (2, 3))):
            low_moved, high_moved = np.abs(self.box[[low, high]] - self.first_box[[low, high]])
            if high_moved > low_moved + _EDGE_MOVED_PX:
                result[axis] = self.box[high] - 0.5 * size_px[axis]
            elif low_moved > high_moved + _EDGE_MOVED_PX:
                result[axis] = self.box[low] + 0.5 * size_px[axis]
        return result

    def by_edges(self, box: FloatArray, expected: FloatArray) -> FloatArray | None:
        """Return the image position (2,) of the object from the edges of a region smaller than the object.

        Along each axis on which the region is too small, one edge belongs to the object and the other to an
        occluder. Of the two positions of the object that the edges imply, the one nearer to the expected
        position is used. Return None if the region is larger than the object.
        """
        size = np.array([box[1] - box[0], box[3] - box[2]])
        if (size > 1.15 * self.size_px + 1.2).any():
            return None
        result = np.zeros(2)
        for axis, (low, high) in enumerate(((box[0], box[1]), (box[2], box[3]))):
            size_px = float(self.size_px[axis])
            middles = np.array([low + 0.5 * size_px, high - 0.5 * size_px]) + self.centre[axis] * size_px
            nearest = middles[np.argmin(np.abs(middles - expected[axis]))]
            result[axis] = nearest if size[axis] < 0.95 * size_px - 0.5 else middles.mean()
        return result

    def is_similar_size(self, size_px: FloatArray) -> bool:
        """Return whether a size is that of the whole object: at most 15 % larger or 8 % smaller, plus about
        a pixel.
        """
        change = np.log(np.maximum(size_px, 0.5) / self.size_px)
        return bool(
            (change < 0.15 + 1.2 / self.size_px).all() and (change > -0.08 - 0.8 / self.size_px).all()
        )
