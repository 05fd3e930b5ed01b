# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of the points of a keyframe in a following image, from which they are tracked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.types import Frame
from cdff_common.types.visual_map_ext import KeyframePoints
from cdff_core.dfns.features_tracking_2d.interface import FeaturesTracking2DInputs, FeaturesTracking2DOutputs
from cdff_core.dfpcs.visual_slam.configuration import PoseGates
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframe
from cdff_core.dfpcs.visual_slam.point_tracker import PointTracker
from cdff_core.dfpcs.visual_slam.view import CameraView
from cdff_core.visual_map.features import ImageFeatures

K = np.array([[200.0, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]])
POINTS_M = np.array([[0.0, 0.0, 4.0], [0.5, -0.25, 2.0], [-0.5, 0.25, 3.0]])


class TrackingDouble:
    """Tracking DFN that records its inputs and loses all points."""

    def __init__(self) -> None:
        self.inputs: list[FeaturesTracking2DInputs] = []

    def process(self, inputs: FeaturesTracking2DInputs) -> FeaturesTracking2DOutputs:
        self.inputs.append(inputs)
        n = len(inputs.features)
        return FeaturesTracking2DOutputs(
            matches=inputs.features, valid=np.zeros(n, np.bool_), scores=np.zeros(n)
        )


def view_of(image: np.ndarray) -> CameraView:
    frame = Frame.from_image(image, stamp_ns=0, camera_matrix=K, sensor="rover/camera")
    unused: Any = None
    return CameraView(0, ("i",), frame, unused, unused)


@pytest.fixture
def track() -> TrackingDouble:
    return TrackingDouble()


@pytest.fixture
def located(track: TrackingDouble) -> Any:
    """Function that locates a view, with a prediction, relative to the keyframe with ``POINTS_M``."""
    unused: Any = None
    tracker = PointTracker(track, unused, PoseGates())  # type: ignore[arg-type]  # double
    view = view_of(np.zeros((120, 160), np.uint8))
    pixels = POINTS_M @ K.T
    view.features = ImageFeatures(
        pixels[:, :2] / pixels[:, 2:], POINTS_M[:, :2] / POINTS_M[:, 2:], np.zeros((3, 1), np.uint8)
    )
    tracker.start(5, view, np.arange(3))
    points = KeyframePoints(POINTS_M, np.full(3, 0.1), np.zeros((3, 1), np.uint8))
    keyframe = VisualKeyframe.of_points(0, points, 200.0)
    return lambda key, T, image: tracker.locate(view_of(image), key, keyframe, T)


def test_points_are_searched_where_the_prediction_projects_them(track: TrackingDouble, located: Any) -> None:
    T = se3.transform(np.eye(3), [0.1, 0.0, 1.0])
    image = np.full((120, 160), 7, np.uint8)
    assert located(5, T, image) is None  # all points are lost
    (inputs,) = track.inputs
    expected = (POINTS_M - [0.1, 0.0, 1.0]) @ K.T
    np.testing.assert_allclose(inputs.guess, expected[:, :2] / expected[:, 2:], atol=1e-9)
    before = POINTS_M @ K.T
    np.testing.assert_allclose(inputs.features, before[:, :2] / before[:, 2:], atol=1e-9)
    np.testing.assert_array_equal(inputs.image, image)
    assert not inputs.reference.any()


def test_patches_are_magnified_by_the_ratio_of_the_depths_within_a_factor_of_four(
    track: TrackingDouble, located: Any
) -> None:
    image = np.zeros((120, 160), np.uint8)
    for forward_m, scales in (
        (1.0, [4 / 3, 2.0, 1.5]),
        (-2.0, [2 / 3, 0.5, 0.6]),
        (1.9, [4 / 2.1, 4.0, 3 / 1.1]),
    ):
        located(5, se3.transform(np.eye(3), [0.0, 0.0, forward_m]), image)
        expected = [np.diag([scale, scale, 1.0]) for scale in scales]
        np.testing.assert_allclose(track.inputs[-1].warps, expected, atol=1e-9)


def test_only_the_newest_keyframe_is_tracked_in_images_of_its_size(
    track: TrackingDouble, located: Any
) -> None:
    assert located(4, np.eye(4), np.zeros((120, 160), np.uint8)) is None
    assert located(5, np.eye(4), np.zeros((100, 160), np.uint8)) is None
    assert track.inputs == []


def test_after_three_lost_images_every_eighth_one_is_tried(track: TrackingDouble, located: Any) -> None:
    tried = []
    for _ in range(17):
        count = len(track.inputs)
        located(5, np.eye(4), np.zeros((120, 160), np.uint8))
        tried.append(len(track.inputs) > count)
    assert [number for number, is_tried in enumerate(tried, 1) if is_tried] == [1, 2, 3, 8, 16]
