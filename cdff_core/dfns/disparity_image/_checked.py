# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of OpenCV's stereo matchers: grey images, margin, left-right check, speckle removal."""

from __future__ import annotations

from abc import abstractmethod
from typing import TypeVar

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import ByteArray, Float32Array
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import Frame
from cdff_core.dfns.disparity_image.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import check_undistorted
from cdff_core.imaging.grey_pair import grey_pair

#: OpenCV's disparities are fixed-point numbers with 4 fractional bits.
_SCALE = 16
#: Area up to which a region of connected disparities is removed; neighbours that differ by at most 1 px are
#: connected.
_MAX_SPECKLE_AREA_PX = 100


class MatcherConfig(DfnConfig):
    """Parameters of all matchers."""

    min_disparity_px: int = Field(0, ge=-512, le=512, description="Smallest disparity searched")
    num_disparities: int = Field(
        128, ge=16, le=1024, description="Number of disparities searched, a multiple of 16"
    )
    uniqueness_percent: int = Field(
        10, ge=0, le=100, description="Minimum margin between the best and the second best cost, in percent"
    )
    left_right_px: float = Field(
        1.0, gt=0, le=16, description="Largest difference between left and right disparity"
    )
    block_px: int = Field(9, ge=1, le=255, description="Edge of the matched block, an odd number")
    fill_px: int = Field(
        0,
        ge=0,
        le=1024,
        description="Widest gap in a row that is filled with the smaller disparity of its sides; 0: none",
    )


MatcherConfigT = TypeVar("MatcherConfigT", bound=MatcherConfig)


class CheckedMatcher(Interface[MatcherConfigT]):
    """Match left to right and right to left, keep the mean where both agree, remove speckles.

    The second match uses both images rotated by 180 degrees. With 3 and 5 paths, OpenCV aggregates costs only
    along paths from above, so that disparities of the ground are biased by 0.1 px towards the smaller ones in
    the rows above. With rotated images the bias has the opposite sign and cancels in the mean.

    The images are extended on the left by the search range, since OpenCV computes no disparity there.

    Optionally, gaps are filled with the smaller disparity of the two sides: an area that is occluded in one
    image belongs to the background [1]_.

    References
    ----------
    .. [1] H. Hirschmueller, Stereo processing by semiglobal matching and mutual information, TPAMI 30(2),
       2008, section 2.5.3, doi:10.1109/TPAMI.2007.1166
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
        self._matcher = self._create_matcher()

    @abstractmethod
    def _create_matcher(self) -> cv2.StereoMatcher:
        """Return the configured OpenCV matcher, with its left-right check and speckle filter disabled."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the disparity image.

        Raises InputError if an image is not rectified or the images differ in size or depth.
        """
        check_undistorted(inputs.left, inputs.right)
        left, right = grey_pair(inputs.left, inputs.right)
        disparity = self._match(left, right)
        rotated = self._match(right[::-1, ::-1], left[::-1, ::-1])[::-1, ::-1]
        filtered = self._remove_speckles(self._mean_of_consistent(disparity, rotated))
        return Outputs(disparity=_disparity_frame(inputs.left, _fill_gaps(filtered, self.config.fill_px)))

    def _match(self, left: ByteArray, right: ByteArray) -> Float32Array:
        """Return the disparities of the left image, NaN without a match."""
        margin = max(self.config.min_disparity_px + self.config.num_disparities, 0)
        extended = [
            cv2.copyMakeBorder(image, 0, 0, margin, 0, cv2.BORDER_REPLICATE) for image in (left, right)
        ]
        fixed = self._matcher.compute(extended[0], extended[1])[:, margin:]
        valid = fixed >= self.config.min_disparity_px * _SCALE
        return np.where(valid, fixed.astype(np.float32) / _SCALE, np.float32(np.nan))

    def _mean_of_consistent(
        self, left_disparity: Float32Array, right_disparity: Float32Array
    ) -> Float32Array:
        """Return the mean of each left disparity and the right one at the matched column.

        NaN if one is missing or they differ by more than ``left_right_px``.
        """
        cols = left_disparity.shape[1]
        right_columns = np.arange(cols, dtype=np.float32)[None, :] - left_disparity
        column = np.rint(np.nan_to_num(right_columns, nan=-1.0)).astype(np.int32)
        is_inside = (column >= 0) & (column < cols)
        right_at_match = np.take_along_axis(right_disparity, np.where(is_inside, column, 0), axis=1)
        agree = is_inside & (np.abs(right_at_match - left_disparity) <= self.config.left_right_px)
        return np.where(agree, np.float32(0.5) * (left_disparity + right_at_match), np.float32(np.nan))

    def _remove_speckles(self, disparity: Float32Array) -> Float32Array:
        """Return the disparities with NaN in small isolated regions."""
        hole = (self.config.min_disparity_px - 1) * _SCALE
        fixed = np.where(np.isfinite(disparity), disparity * _SCALE, hole).astype(np.int16)
        cv2.filterSpeckles(fixed, hole, _MAX_SPECKLE_AREA_PX, _SCALE)
        return np.where(fixed == hole, np.float32(np.nan), disparity)


def _fill_gaps(disparity: Float32Array, max_width_px: int) -> Float32Array:
    """Return the disparities with gaps in rows filled by the smaller side; gaps at the border remain."""
    width = disparity.shape[1]
    if max_width_px == 0 or width == 0:
        return disparity
    has_disparity, columns = np.isfinite(disparity), np.arange(width)
    previous_valid = np.maximum.accumulate(np.where(has_disparity, columns, -1), axis=1)
    next_valid = np.minimum.accumulate(np.where(has_disparity, columns, width)[:, ::-1], axis=1)[:, ::-1]
    sides = (
        np.take_along_axis(disparity, np.clip(at, 0, width - 1), axis=1)
        for at in (previous_valid, next_valid)
    )
    is_gap = (
        ~has_disparity
        & (previous_valid >= 0)
        & (next_valid < width)
        & (next_valid - previous_valid - 1 <= max_width_px)
    )
    return np.where(is_gap, np.minimum(*sides), disparity)


def _disparity_frame(left: Frame, disparity: Float32Array) -> Frame:
    """Return a disparity image with the camera and stamp of the left image."""
    return Frame.from_image(
        disparity,
        stamp_ns=left.stamp_ns,
        mode="UNDEF",
        sensor=left.frame,
        T_robot_sensor=left.T_robot_sensor,
        camera_matrix=left.camera_matrix if np.any(left.camera_matrix) else None,
    )
