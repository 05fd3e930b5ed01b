# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image of a camera with its features, and the measurement of their depths."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np

from cdff_common.arrays import BoolArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import DistanceImage, Frame, FramePair
from cdff_core.imaging.frames import check_principal_point, check_simultaneous, check_undistorted
from cdff_core.imaging.grey import checked_image, grey_image
from cdff_core.imaging.rectified_camera import RectifiedCamera
from cdff_core.stereo_odometry.robot_masks import RobotMasks
from cdff_core.visual_map.features import FeatureExtractor, ImageFeatures
from cdff_core.visual_map.keyframe_points import (
    MatchingDfn,
    MeasuredPoints,
    RefinementDfn,
    measured_by_depth,
    measured_by_pair,
)

#: Largest difference between the times of an image and its depth image.
_MAX_GAP_NS = 20_000_000


class CameraView:
    """Image of a camera; its features are made when they are needed.

    Attributes
    ----------
    stamp_ns : int
    inputs : tuple of str
        Ids of the samples.
    frame : str
        Frame of the camera; empty if the image has none.
    image : ndarray of uint8, shape (rows, columns)
        Grey values.
    camera : CameraModel
    focal_px : float
    """

    def __init__(
        self,
        stamp_ns: int,
        inputs: tuple[str, ...],
        frame: Frame,
        extractor: FeatureExtractor,
        measure: Callable[[ImageFeatures], MeasuredPoints],
        mask: BoolArray | None = None,
    ) -> None:
        self.stamp_ns, self.inputs, self.frame = stamp_ns, inputs, frame.frame
        check_principal_point(frame)
        self.camera = CameraModel.of_frame(frame)
        self.image = checked_image(grey_image(frame))
        self.focal_px = float(np.sqrt(self.camera.fx * self.camera.fy))
        self._extractor, self._measure, self._mask = extractor, measure, mask

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the image."""
        rows, columns = self.image.shape
        return rows, columns

    @cached_property
    def features(self) -> ImageFeatures:
        """Described features, without those on the robot."""
        return self._extractor.extract(self.image, self.camera, self._mask)

    @cached_property
    def measured(self) -> MeasuredPoints:
        """Points of the features with a measured depth."""
        return self._measure(self.features)


class ViewBuilder:
    """Makes views of stereo pairs, and of colour images with their depth images."""

    def __init__(
        self,
        extractor: FeatureExtractor,
        match: MatchingDfn,
        refine: RefinementDfn,
        masks: RobotMasks,
        depth_offset_m: tuple[float, float, float],
    ) -> None:
        self._extractor, self._match, self._refine, self._masks = extractor, match, refine, masks
        self._T_camera_depth = se3.transform(np.eye(3), depth_offset_m)
        self.clear()

    def clear(self) -> None:
        """Remove the image that waits for its depth image, or the depth image that waits for its image."""
        self._waiting: Sample | None = None

    def of_pair(self, sample: Sample) -> CameraView:
        """Return the view of the left image; raises InputError if the pair is unusable."""
        pair: FramePair = sample.value
        check_undistorted(pair.left, pair.right)
        check_simultaneous(pair.left, pair.right)
        RectifiedCamera.from_matrix(pair.left.camera_matrix, pair.baseline)
        left, right = grey_image(pair.left), grey_image(pair.right)
        if left.shape != right.shape:
            raise InputError(f"images of {left.shape} and {right.shape} pixels, expected equal sizes")
        measure = partial(measured_by_pair, pair, match=self._match, refine=self._refine)
        mask, _ = self._masks.of_pair(pair)
        return CameraView(sample.stamp_ns, (sample.id,), pair.left, self._extractor, measure, mask)

    def of_rgbd(self, sample: Sample) -> tuple[CameraView | None, Sample | None]:
        """Return the view of an image and its depth image, and an image whose depth image is missing.

        The view is None while the other sample of its time has not arrived.

        Raises
        ------
        InputError
            If the image or its camera is unusable.
        """
        other, self._waiting = self._waiting, None
        if other is None or other.port == sample.port or abs(other.stamp_ns - sample.stamp_ns) > _MAX_GAP_NS:
            self._waiting = sample
            return None, other if other is not None and other.port == "image" else None
        image, depth = (other, sample) if sample.port == "depth" else (sample, other)
        frame: Frame = image.value
        distances: DistanceImage = depth.value
        measure = partial(
            measured_by_depth,
            distances,
            focal_px=CameraModel.of_frame(frame).fx,
            T_camera_depth=self._T_camera_depth,
        )
        return CameraView(image.stamp_ns, (image.id, depth.id), frame, self._extractor, measure), None

    def take_waiting(self) -> Sample | None:
        """Return the image that still waits for its depth image, and remove it."""
        waiting, self._waiting = self._waiting, None
        return waiting if waiting is not None and waiting.port == "image" else None
