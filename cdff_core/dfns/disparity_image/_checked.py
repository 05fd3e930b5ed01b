# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of OpenCV's stereo matchers: grey images, margin, left-right check, removal of specks."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.arrays import ByteArray, Float32Array
from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import Frame
from cdff_core.dfns.disparity_image.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import check_straight

_TO_GREY = {
    "MODE_RGB": cv2.COLOR_RGB2GRAY,
    "MODE_RGBA": cv2.COLOR_RGBA2GRAY,
    "MODE_BGR": cv2.COLOR_BGR2GRAY,
    "MODE_BGRA": cv2.COLOR_BGRA2GRAY,
}
#: OpenCV's disparities are fixed-point numbers with 4 fractional bits.
_SCALE = 16
#: Area up to which connected disparities are removed; those that differ by at most 1 px are connected.
_SPECK_PX = 100


class MatcherConfig(DfnConfig):
    """Parameters of all matchers."""

    min_disparity_px: int = Field(0, ge=-512, le=512, description="Smallest disparity searched")
    num_disparities: int = Field(
        128, ge=16, le=1024, description="Number of disparities searched, a multiple of 16"
    )
    uniqueness_percent: int = Field(
        10, ge=0, le=100, description="Margin of the best over the second best cost"
    )
    left_right_px: float = Field(
        1.0, gt=0, le=16, description="Largest difference of left and right disparity"
    )
    block_px: int = Field(9, ge=1, le=255, description="Edge of the matched block; odd")
    fill_px: int = Field(
        0,
        ge=0,
        le=1024,
        description="Widest gap in a row that is filled with the smaller of its two sides; 0: none",
    )


MatcherConfigT = TypeVar("MatcherConfigT", bound=MatcherConfig)


class CheckedMatcher(Interface[MatcherConfigT]):
    """Match left to right and right to left, keep the mean where both agree, remove specks.

    The second match uses both images rotated by 180 degrees: with 3 and 5 paths OpenCV aggregates only along
    paths from above, which biases disparities of the ground by 0.1 px towards the smaller ones farther up.
    With rotated images the bias has the opposite sign, and the mean has none.

    The images are extended on the left by the search range, since OpenCV computes no disparity there.

    Optionally gaps are filled with the smaller disparity of the two sides: an area that one camera does not
    see belongs to the background [1]_.

    References
    ----------
    .. [1] H. Hirschmueller, Stereo processing by semiglobal matching and mutual information, TPAMI 30(2),
       2008,
       section 2.5.3, doi:10.1109/TPAMI.2007.1166
    """

    def setup(self) -> None:
        """Create the matcher; raises ConfigurationError for parameters that OpenCV does not accept."""
        if self.config.num_disparities % 16:
            raise ConfigurationError(
                f"{type(self).__name__}: num_disparities={self.config.num_disparities}: expected a "
                "multiple of 16"
            )
        if self.config.block_px % 2 == 0:
            raise ConfigurationError(
                f"{type(self).__name__}: block_px={self.config.block_px}: expected an odd number"
            )
        self._matcher = self._matcher_of_opencv()

    @abstractmethod
    def _matcher_of_opencv(self) -> cv2.StereoMatcher:
        """Return OpenCV's matcher as configured, without its own checks on both images."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the disparity image; raises InputError on raw images or different sizes or depths."""
        check_straight(inputs.left, inputs.right)
        left, right = grey_pair(inputs.left, inputs.right)
        disparity = self._match(left, right)
        rotated = self._match(right[::-1, ::-1], left[::-1, ::-1])[::-1, ::-1]
        filtered = self._without_specks(self._mean(disparity, rotated))
        return Outputs(disparity=_like(inputs.left, _filled(filtered, self.config.fill_px)))

    def _match(self, left: ByteArray, right: ByteArray) -> Float32Array:
        pad = max(self.config.min_disparity_px + self.config.num_disparities, 0)
        wide = [cv2.copyMakeBorder(i, 0, 0, pad, 0, cv2.BORDER_REPLICATE) for i in (left, right)]
        fixed = self._matcher.compute(wide[0], wide[1])[:, pad:]
        valid = fixed >= self.config.min_disparity_px * _SCALE
        return np.where(valid, fixed.astype(np.float32) / _SCALE, np.float32(np.nan))

    def _mean(self, left: Float32Array, right: Float32Array) -> Float32Array:
        """Return the mean with the right disparity at the matched column; NaN where they differ."""
        cols = left.shape[1]
        matched = np.arange(cols, dtype=np.float32)[None, :] - left
        column = np.rint(np.nan_to_num(matched, nan=-1.0)).astype(np.int32)
        inside = (column >= 0) & (column < cols)
        there = np.take_along_axis(right, np.where(inside, column, 0), axis=1)
        agree = inside & (np.abs(there - left) <= self.config.left_right_px)
        return np.where(agree, np.float32(0.5) * (left + there), np.float32(np.nan))

    def _without_specks(self, disparity: Float32Array) -> Float32Array:
        hole = (self.config.min_disparity_px - 1) * _SCALE
        fixed = np.where(np.isfinite(disparity), disparity * _SCALE, hole).astype(np.int16)
        cv2.filterSpeckles(fixed, hole, _SPECK_PX, _SCALE)
        return np.where(fixed == hole, np.float32(np.nan), disparity)


def _filled(disparity: Float32Array, widest_px: int) -> Float32Array:
    """Return disparities with gaps along rows filled by the smaller side; gaps at the border remain."""
    cols = disparity.shape[1]
    if widest_px == 0 or cols == 0:
        return disparity
    known, here = np.isfinite(disparity), np.arange(cols)
    before = np.maximum.accumulate(np.where(known, here, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, here, cols)[:, ::-1], axis=1)[:, ::-1]
    sides = (np.take_along_axis(disparity, np.clip(at, 0, cols - 1), axis=1) for at in (before, after))
    gap = ~known & (before >= 0) & (after < cols) & (after - before - 1 <= widest_px)
    return np.where(gap, np.minimum(*sides), disparity)


def grey_pair(left: Frame, right: Frame) -> tuple[ByteArray, ByteArray]:
    """Return both images as 8-bit grey ``(rows, cols)``; 16-bit images are scaled by the left's 99.9th
    percentile.

    Raises
    ------
    InputError
        If they differ in size or depth, or are neither 8 nor 16 bit.
    """
    a, b = left.image, right.image
    if a.shape[:2] != b.shape[:2] or a.dtype != b.dtype or a.size == 0:
        raise InputError(
            f"left {a.dtype} {a.shape}, right {b.dtype} {b.shape}: expected the same size and depth"
        )
    if a.dtype not in (np.uint8, np.uint16):
        raise InputError(f"images of {a.dtype}: expected uint8 or uint16")
    greys = [_grey(a, left.metadata.mode.name), _grey(b, right.metadata.mode.name)]
    if a.dtype == np.uint16:
        top = max(float(np.percentile(greys[0], 99.9)), 1.0)
        greys = [np.clip(g.astype(np.float32) * (255.0 / top), 0, 255).astype(np.uint8) for g in greys]
    return greys[0], greys[1]


def _grey(image: NDArray[Any], mode: str) -> NDArray[Any]:
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    default = "MODE_RGB" if image.shape[2] == 3 else "MODE_RGBA"
    return cv2.cvtColor(np.ascontiguousarray(image), _TO_GREY.get(mode, _TO_GREY[default]))


def _like(left: Frame, disparity: Float32Array) -> Frame:
    return Frame.from_image(
        disparity,
        stamp_ns=left.stamp_ns,
        mode="UNDEF",
        sensor=left.frame,
        T_robot_sensor=left.T_robot_sensor,
        camera_matrix=left.camera_matrix if np.any(left.camera_matrix) else None,
    )
