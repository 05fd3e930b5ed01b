# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points of a keyframe, measured by a rectified stereo pair or by a depth image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from cdff_common.arrays import BoolArray, Float32Array, FloatArray, IntArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import DistanceImage, Frame, FramePair
from cdff_common.types.visual_map_ext import KeyframePoints
from cdff_core.dfns.rectification_refinement.interface import (
    RectificationRefinementInputs,
    RectificationRefinementOutputs,
)
from cdff_core.dfns.stereo_matching_2d.interface import StereoMatching2DInputs, StereoMatching2DOutputs
from cdff_core.imaging.grey import grey_image
from cdff_core.imaging.rectified_camera import RectifiedCamera
from cdff_core.visual_map.features import FeatureExtractor, ImageFeatures

MatchingDfn = Dfn[Any, StereoMatching2DInputs, StereoMatching2DOutputs]
RefinementDfn = Dfn[Any, RectificationRefinementInputs, RectificationRefinementOutputs]
#: Standard deviation of a disparity of a feature, pixels.
_DISPARITY_SIGMA_PX = 0.3
#: Largest depth in baselines: 1 px of disparity at a focal length of 450 px.
_MAX_BASELINES = 450.0
#: Standard deviation of a depth image: a ratio of the squared depth (structured light), 1/m.
_DEPTH_SIGMA_PER_M = 0.003
#: Largest distance in the image of a feature from a measured point, pixels, and largest ratio of the depths
#: around it: features on the edge of an object have no certain depth.
_MAX_OFFSET_PX, _MAX_DEPTH_RATIO = 1.5, 1.05


@dataclass(frozen=True, slots=True, eq=False)
class StereoMeasurement:
    """Pixels and disparities of points, from which their positions follow for any error of the rectification.

    Attributes
    ----------
    measurements : ndarray, shape (n, 3)
        Column, row and disparity, corrected as far as row offsets determine the errors, pixels.
    basis : ndarray, shape (n, 2)
        Derivatives of the disparities with respect to the two errors that the row offsets do not determine.
    camera_matrix : ndarray, shape (3, 3)
    baseline_m : float
    open_covariance : ndarray, shape (2, 2)
        Prior covariance of these errors, square pixels.
    """

    measurements: FloatArray
    basis: FloatArray
    camera_matrix: FloatArray
    baseline_m: float
    open_covariance: FloatArray

    def positions(self, errors_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the positions (n, 3) and the standard deviations of the depths (n,) for errors (2,)."""
        K = self.camera_matrix
        min_disparity_px = K[0, 0] / _MAX_BASELINES
        disparities = np.maximum(self.measurements[:, 2] + self.basis @ errors_px, min_disparity_px)
        depths = K[0, 0] * self.baseline_m / disparities
        rays = np.column_stack(
            [
                (self.measurements[:, 0] - K[0, 2]) / K[0, 0],
                (self.measurements[:, 1] - K[1, 2]) / K[1, 1],
                np.ones(len(depths)),
            ]
        )
        return rays * depths[:, None], depths * _DISPARITY_SIGMA_PX / disparities

    def of_rows(self, rows: IntArray) -> StereoMeasurement:
        """Return the measurement of some of the points."""
        return replace(self, measurements=self.measurements[rows], basis=self.basis[rows])

    def has_same_camera(self, other: StereoMeasurement) -> bool:
        """Return whether camera matrix and baseline are equal."""
        same_lens = np.array_equal(self.camera_matrix, other.camera_matrix)
        return same_lens and self.baseline_m == other.baseline_m


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPoints:
    """Points of the features whose depth was measured.

    Attributes
    ----------
    points : KeyframePoints
    features : ndarray of int, shape (n,)
        Row of the feature of each point.
    stereo : StereoMeasurement or None
        Of the points of a stereo pair, if the errors of the rectification are estimated.
    """

    points: KeyframePoints
    features: IntArray
    stereo: StereoMeasurement | None = None

    def without(self, features: IntArray) -> MeasuredPoints:
        """Return the points of the other features than these rows (k,)."""
        rows = np.flatnonzero(~np.isin(self.features, features))
        points = self.points
        return MeasuredPoints(
            KeyframePoints(points.positions_m[rows], points.depth_sigmas_m[rows], points.descriptors[rows]),
            self.features[rows],
            None if self.stereo is None else self.stereo.of_rows(rows),
        )


def points_of_pair(pair: FramePair, extractor: FeatureExtractor, match: MatchingDfn) -> KeyframePoints:
    """Return the features of the left image with a unique disparity.

    Raises
    ------
    InputError
        If the camera matrix or the baseline is invalid.
    """
    RectifiedCamera.from_matrix(pair.left.camera_matrix, pair.baseline)
    features = extractor.extract(grey_image(pair.left), CameraModel.of_frame(pair.left))
    return measured_by_pair(pair, features, match).points


def points_of_depth(
    frame: Frame, depth: DistanceImage, extractor: FeatureExtractor, T_camera_depth: FloatArray
) -> KeyframePoints:
    """Return the features of a colour image whose depth the depth image determines.

    ``T_camera_depth`` (4, 4) is the pose of the depth camera in the frame of the colour camera; the images
    need not be registered.

    Raises
    ------
    InputError
        If the depth image does not have the stated size.
    """
    camera = CameraModel.of_frame(frame)
    features = extractor.extract(grey_image(frame), camera)
    return measured_by_depth(depth, features, camera.fx, T_camera_depth).points


def measured_by_pair(
    pair: FramePair, features: ImageFeatures, match: MatchingDfn, refine: RefinementDfn | None = None
) -> MeasuredPoints:
    """Return the points of the features of the left image that have a unique disparity.

    With ``refine``, errors of the rectification are corrected as far as row offsets determine them.

    Raises
    ------
    InputError
        If the camera matrix or the baseline is invalid.
    """
    camera = RectifiedCamera.from_matrix(pair.left.camera_matrix, pair.baseline)
    left, right = grey_image(pair.left), grey_image(pair.right)
    stereo_matches = match.process(StereoMatching2DInputs(left=left, right=right, features=features.pixels))
    min_disparity_px = camera.fx / _MAX_BASELINES
    usable = stereo_matches.valid & (
        np.where(stereo_matches.valid, stereo_matches.disparities, 0.0) > min_disparity_px
    )
    disparities, stereo = stereo_matches.disparities[usable], None
    if refine is not None:
        K = np.array(pair.left.camera_matrix, np.float64)
        pixels = features.pixels[usable]
        field = refine.process(
            RectificationRefinementInputs(
                features=pixels,
                disparities=disparities,
                camera_matrix=K,
                row_offsets=stereo_matches.row_offsets[usable],
            )
        )
        disparities = np.maximum(disparities + field.corrections, min_disparity_px)
        stereo = StereoMeasurement(
            np.column_stack([pixels, disparities]), field.basis, K, camera.baseline_m, field.open_covariance
        )
    depths = camera.fx * camera.baseline_m / disparities
    sigmas = depths * _DISPARITY_SIGMA_PX / disparities
    measured_points = _points(features, usable, depths, sigmas)
    return replace(measured_points, stereo=stereo)


def measured_by_depth(
    depth: DistanceImage, features: ImageFeatures, focal_px: float, T_camera_depth: FloatArray
) -> MeasuredPoints:
    """Return the points of the features of a colour image whose depth the depth image determines.

    ``focal_px`` is the focal length of the colour camera.

    Raises
    ------
    InputError
        If the depth image does not have the stated size.
    """
    if len(depth.data) != depth.width * depth.height:
        raise InputError(f"depth image: {len(depth.data)} distances, expected {depth.width} x {depth.height}")
    points = se3.transform_points(T_camera_depth, _depth_points(depth))
    points = points[points[:, 2] > 0.1]
    if len(points) < 4 or not len(features):
        return _points(features, np.zeros(len(features), bool), np.zeros(0), np.zeros(0))
    tree = cKDTree(points[:, :2] / points[:, 2:])
    offsets, rows = tree.query(features.directions, k=4)
    z = points[rows, 2]
    usable = (offsets[:, 3] * focal_px < 2.0 * _MAX_OFFSET_PX) & (z.max(1) < _MAX_DEPTH_RATIO * z.min(1))
    depths = z[usable].mean(axis=1)
    return _points(features, usable, depths, _DEPTH_SIGMA_PER_M * depths**2)


def registered_depth(frame: Frame, depth: DistanceImage, T_camera_depth: FloatArray) -> Float32Array:
    """Return the depth (rows, columns) of the pixels of a colour image, metres.

    It is that of the nearest point in each pixel, 0 without one.
    """
    camera = CameraModel.of_frame(frame)
    points = se3.transform_points(T_camera_depth, _depth_points(depth))
    columns, rows = np.nan_to_num(np.rint(camera.project(points)), nan=-1.0).astype(np.int64).T
    inside = (rows >= 0) & (rows < camera.rows) & (columns >= 0) & (columns < camera.cols)
    order = np.flatnonzero(inside)[np.argsort(-points[inside, 2], kind="stable")]
    image = np.zeros((camera.rows, camera.cols), np.float32)
    image[rows[order], columns[order]] = points[order, 2]
    return image


def _depth_points(depth: DistanceImage) -> FloatArray:
    """Return the points (n, 3) of the pixels with a distance, in the frame of the depth camera, metres."""
    distances = np.asarray(depth.data, np.float64).reshape(depth.height, depth.width)
    rows, columns = np.nonzero(distances > 0.0)
    z = distances[rows, columns]
    x = columns * depth.scale_x + depth.center_x
    y = rows * depth.scale_y + depth.center_y
    return np.column_stack([x * z, y * z, z])


def _points(
    features: ImageFeatures, usable: BoolArray, depths: FloatArray, sigmas: FloatArray
) -> MeasuredPoints:
    directions = np.column_stack([features.directions[usable], np.ones(len(depths))])
    points = KeyframePoints(directions * depths[:, None], sigmas, features.descriptors[usable])
    return MeasuredPoints(points, np.flatnonzero(usable))
