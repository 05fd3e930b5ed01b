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


def scene(k: int) -> Scene:
    """Return an image with one region, from a camera at rest."""
    labels = np.zeros((120, 160), np.int32)
    labels[50:65, 60:81] = 1
    regions = MovingRegionDetectionOutputs(
        boxes=BOX[None],
        centroids=CENTROID[None],
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


def tracked(place_px: np.ndarray, score: float) -> Any:
    """Return the object of a region after a second image, in which its appearance is matched at a place."""
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
