# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Position of an object from its region and its appearance, with doubles of the DFNs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_core.bearing_tracking.camera_attitude import CameraAttitude
from cdff_core.dfns.appearance_tracking.interface import AppearanceTrackingOutputs
from cdff_core.dfns.bearing_filtering.interface import BearingFilteringInputs, BearingFilteringOutputs
from cdff_core.dfns.moving_region_detection.interface import MovingRegionDetectionOutputs
from cdff_core.dfns.track_association.interface import TrackAssociationInputs, TrackAssociationOutputs
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig
from cdff_core.dfpcs.far_range_tracking.object_tracks import ObjectTracks
from cdff_core.dfpcs.far_range_tracking.observer import Observer
from cdff_core.dfpcs.far_range_tracking.scene import Scene

CAMERA = CameraModel(120, 160, 400.0, 400.0, 79.5, 59.5)
CENTROID = np.array([70.0, 57.0])
#: First and last column, first and last row; the largest side is 20 px.
BOX = np.array([60.0, 80.0, 50.0, 64.0])
CONFIG = FarRangeTrackingConfig()


def scene(k: int, box: np.ndarray = BOX) -> Scene:
    """Return an image with one region, from a camera at rest."""
    labels = np.zeros((120, 160), np.int32)
    labels[int(box[2]) : int(box[3]) + 1, int(box[0]) : int(box[1]) + 1] = 1
    regions = MovingRegionDetectionOutputs(
        boxes=box[None],
        centroids=np.array([[0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])]]),
        covariances=0.04 * np.eye(2)[None],
        areas=np.array([280.0]),
        significances=np.array([20.0]),
        sharpness=np.array([1.0]),
        labels=labels,
        noise=1.0,
    )
    attitude = CameraAttitude(np.eye(3), np.zeros((3, 3)), np.zeros(0, bool))
    observer = Observer(attitude, "camera", "camera", None, np.zeros((3, 3)), False)
    return Scene(100_000_000 * k, np.zeros((120, 160), np.uint8), CAMERA, observer, regions, None, None, 1.0)


def measured(inputs: BearingFilteringInputs) -> BearingFilteringOutputs:
    """Return the measured directions, or the previous ones if there is no measurement."""
    directions = inputs.directions if inputs.measured is None else inputs.measured
    return BearingFilteringOutputs(
        directions=directions, rates=inputs.rates, covariances=inputs.covariances, nis=np.zeros(1)
    )


def first_region(inputs: TrackAssociationInputs) -> TrackAssociationOutputs:
    m = len(inputs.places)
    return TrackAssociationOutputs(
        chosen=np.zeros(m, np.int64), costs=np.zeros(m), is_ambiguous=np.zeros(m, bool)
    )


def tracked(place_px: np.ndarray, score: float, last_box: np.ndarray | None = None) -> Any:
    """Return the object of a region after a second image, in which its appearance is matched at a place.

    With ``last_box``, the object is confirmed, and a third image shows a region with this box.
    """
    match = AppearanceTrackingOutputs(
        place=place_px, covariance=0.01 * np.eye(2), scale=1.0, score=score, second=0.0
    )
    nodes: list[Any] = [SimpleNamespace(process=f) for f in (measured, lambda _: match, first_region)]
    tracks = ObjectTracks(nodes[0], nodes[0], nodes[1], nodes[2], CONFIG)
    tracks.step(scene(1))
    (o,) = tracks.objects
    o.anchor_variance = 0.01  # the offset between region and appearance is well known
    tracks.step(scene(2))
    assert o.region == 0
    assert o.is_whole
    if last_box is not None:
        o.number = 1
        tracks.step(scene(3, last_box))
    return o


def test_an_appearance_that_agrees_with_the_region_gives_the_position() -> None:
    place_px = CENTROID + np.array([2.0, -1.0])
    o = tracked(place_px, 0.9)
    assert np.linalg.norm(o.pixel - place_px) < 0.3
    assert np.trace(o.pixel_covariance) < 0.06
    assert o.score == 0.9


@pytest.mark.parametrize(
    ("offset_px", "score"),
    [(2.0, CONFIG.min_score), (6.5, 0.9), (np.nan, 0.9)],
    ids=["poorly correlated", "farther than 0.3 of the size", "not found"],
)
def test_otherwise_the_region_gives_the_position(offset_px: float, score: float) -> None:
    o = tracked(CENTROID + np.array([offset_px, 0.0]), score)
    np.testing.assert_allclose(o.pixel, CENTROID, atol=1e-9)
    # That of the region, and its varying shape.
    np.testing.assert_allclose(np.diag(o.pixel_covariance), 0.04 + 0.15**2 + np.array([0.2, 0.14]) ** 2)


def test_the_appearance_gives_the_position_of_an_object_whose_region_includes_dust() -> None:
    place_px = CENTROID + np.array([1.0, 0.5])
    o = tracked(place_px, 0.9, last_box=BOX + np.array([0.0, 12.0, 0.0, 0.0]))
    assert not o.is_whole
    np.testing.assert_allclose(o.pixel, place_px, atol=0.2)  # the middle of the region is 5 px away
    assert o.region == 0
    assert np.trace(o.pixel_covariance) < 0.2


def test_a_hidden_side_moves_the_position_of_a_poorly_correlated_object_away_from_the_visible_side() -> None:
    # The right half is hidden: the left edge and the known size give the middle.
    o = tracked(np.full(2, np.nan), 0.0, last_box=BOX - np.array([0.0, 10.0, 0.0, 0.0]))
    assert o.pixel[0] == pytest.approx(70.0, abs=0.5)
    assert np.sqrt(o.pixel_covariance[0, 0]) > 1.0


def test_a_clear_object_shrinks_fast_and_grows_slowly_and_a_hidden_one_the_other_way_round() -> None:
    changes = {}
    for is_clear in (True, False):
        for factor in (0.8, 1.25):
            o = tracked(CENTROID, 0.9)
            o.hits = 100
            before = o.size_px.copy()
            o.resize(factor * before, is_clear=is_clear)
            changes[is_clear, factor] = float(np.abs(np.log(o.size_px / before)).mean())
    assert changes[True, 0.8] > 2.0 * changes[True, 1.25]
    assert changes[False, 1.25] > 2.0 * changes[False, 0.8]


def test_a_body_that_comes_into_view_extends_from_its_moving_edge() -> None:
    o = tracked(CENTROID, 0.9)
    o.first_box, o.box = np.array([160.0, 163.0, 50.0, 64.0]), np.array([160.0, 172.0, 50.0, 64.0])
    middle = o.whole_middle(np.array([20.0, 14.0]), np.array([190.0, 58.0]))
    np.testing.assert_allclose(middle, [162.0, 58.0])
    o.first_box, o.box = np.array([90.0, 100.0, 50.0, 64.0]), np.array([84.0, 100.0, 50.0, 64.0])
    assert o.whole_middle(np.array([20.0, 14.0]), np.array([190.0, 58.0]))[0] == pytest.approx(94.0)
