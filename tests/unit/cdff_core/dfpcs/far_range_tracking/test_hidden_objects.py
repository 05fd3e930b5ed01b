# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Objects that are hidden in part, are hidden, or have a region of another size, with doubles of the DFNs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.bearing_tracking.motion import BearingStates
from cdff_core.dfns.appearance_tracking.interface import AppearanceTrackingOutputs
from cdff_core.dfns.bearing_filtering.interface import BearingFilteringInputs, BearingFilteringOutputs
from cdff_core.dfns.moving_region_detection.interface import MovingRegionDetectionOutputs
from cdff_core.dfns.track_association.interface import TrackAssociationInputs, TrackAssociationOutputs
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig
from cdff_core.dfpcs.far_range_tracking.object_tracks import ObjectTracks
from tests.unit.cdff_core.dfpcs.far_range_tracking.test_object_tracks import BOX, CENTROID, scene

NOWHERE = np.full(2, np.nan)


class Doubles:
    """Doubles of the DFNs of a tracker: the filters return the measurement or the previous direction.

    Attributes
    ----------
    match_px, score : ndarray (2,), float
        Position and correlation of each appearance; NaN for no match.
    chosen : int
        Region of each object; -1 for none.
    seen, coasting : list of BearingFilteringInputs
        Inputs of both filters.
    associations : list of TrackAssociationInputs
    """

    def __init__(self) -> None:
        self.match_px, self.score, self.chosen = CENTROID, 0.9, 0
        self.seen: list[BearingFilteringInputs] = []
        self.coasting: list[BearingFilteringInputs] = []
        self.associations: list[TrackAssociationInputs] = []
        processes = (self._seen, self._coasting, self._matched, self._associated)
        nodes: list[Any] = [SimpleNamespace(process=process) for process in processes]
        self.tracks = ObjectTracks(*nodes, FarRangeTrackingConfig())

    def confirmed_object(self) -> Any:
        """Return the object of a region in two images, confirmed and at rest."""
        self.tracks.step(scene(1))
        self.tracks.step(scene(2))
        (o,) = self.tracks.objects
        o.number = 1
        return o

    def _seen(self, inputs: BearingFilteringInputs) -> BearingFilteringOutputs:
        self.seen.append(inputs)
        return _filtered(inputs)

    def _coasting(self, inputs: BearingFilteringInputs) -> BearingFilteringOutputs:
        self.coasting.append(inputs)
        return _filtered(inputs)

    def _matched(self, _: object) -> AppearanceTrackingOutputs:
        return AppearanceTrackingOutputs(
            place=self.match_px, covariance=0.01 * np.eye(2), scale=1.0, score=self.score, second=0.0
        )

    def _associated(self, inputs: TrackAssociationInputs) -> TrackAssociationOutputs:
        self.associations.append(inputs)
        m = len(inputs.places)
        return TrackAssociationOutputs(
            chosen=np.full(m, self.chosen), costs=np.zeros(m), is_ambiguous=np.zeros(m, bool)
        )


def _filtered(inputs: BearingFilteringInputs) -> BearingFilteringOutputs:
    directions = inputs.directions if inputs.measured is None else inputs.measured
    return BearingFilteringOutputs(
        directions=directions, rates=inputs.rates, covariances=inputs.covariances, nis=np.zeros(1)
    )


def no_regions(k: int) -> Any:
    image = scene(k)
    regions: dict[str, Any] = {
        name: getattr(image.regions, name)[:0]
        for name in ("boxes", "centroids", "covariances", "areas", "significances", "sharpness")
    }
    empty = MovingRegionDetectionOutputs(**regions, labels=np.zeros((120, 160), np.int32), noise=1.0)
    values = {name: getattr(image, name) for name in image.__dataclass_fields__}
    return type(image)(**{**values, "regions": empty})


def rotated(s: BearingStates, angle_rad: float) -> BearingStates:
    R = se3.exp_so3(np.array([0.0, angle_rad, 0.0]))
    return BearingStates(s.directions @ R.T, s.rates, s.covariances)


def test_an_object_that_disappears_coasts_from_the_images_that_show_it_whole() -> None:
    doubles = Doubles()
    o = doubles.confirmed_object()
    whole = o.clear_states.directions.copy()
    o.states = rotated(o.states, 0.01)  # the visible part pulls the position of the partly hidden object
    doubles.match_px, doubles.score = NOWHERE, -1.0
    doubles.tracks.step(no_regions(3))
    assert o.misses == 1
    np.testing.assert_allclose(o.states.directions, whole)
    o.states = rotated(o.states, 0.01)
    doubles.tracks.step(no_regions(4))
    assert o.misses == 2
    assert np.linalg.norm(o.states.directions - whole) > 0.009, "only the first miss selects the state"


@pytest.mark.parametrize(
    ("width_px", "score", "is_clear"),
    [(20.0, 0.9, True), (32.0, 0.9, True), (10.0, 0.3, False)],
    ids=["whole", "with dust", "half hidden"],
)
def test_only_images_in_full_view_correct_the_slower_filter(
    width_px: float, score: float, is_clear: bool
) -> None:
    doubles = Doubles()
    doubles.confirmed_object()
    doubles.score = score
    doubles.coasting.clear()
    doubles.tracks.step(scene(3, BOX + np.array([0.0, width_px - 20.0, 0.0, 0.0])))
    measurements = [inputs.measured for inputs in doubles.coasting if inputs.measured is not None]
    assert len(measurements) == int(is_clear)


def test_both_states_are_rotated_into_another_frame() -> None:
    doubles = Doubles()
    o = doubles.confirmed_object()
    R = se3.exp_so3(np.array([0.3, -0.2, 0.1]))
    expected = [s.directions[0] @ R.T for s in (o.states, o.clear_states)]
    doubles.tracks.rotate(R)
    np.testing.assert_allclose([o.states.directions[0], o.clear_states.directions[0]], expected)


def test_a_coasting_object_is_not_associated_with_the_region_of_an_object_in_view() -> None:
    doubles = Doubles()
    o = doubles.confirmed_object()
    doubles.tracks.objects.append(
        hidden := doubles.tracks._new(CENTROID, np.eye(2), o.size_px, o.appearance, scene(2))
    )
    hidden.number, hidden.misses = 2, 5
    doubles.tracks.step(scene(3))
    (similarities,) = [a.similarities for a in doubles.associations if len(a.places) == 2]
    np.testing.assert_allclose(similarities[:, 0], [0.9, -1.0])


def test_a_coasting_object_is_found_again_in_the_region_that_resembles_it() -> None:
    doubles = Doubles()
    o = doubles.confirmed_object()
    o.misses = 5
    doubles.tracks.step(scene(3))
    np.testing.assert_allclose(doubles.associations[-1].similarities, [[0.9]])
    assert o.misses == 0


def test_dust_makes_an_object_in_full_view_hardly_larger_and_its_score_is_not_learnt() -> None:
    doubles = Doubles()
    o = doubles.confirmed_object()
    o.hits, o.size_px, o.usual_score = 100, np.array([20.0, 14.0]), 0.8
    doubles.tracks.step(scene(3, BOX + np.array([0.0, 20.0, 0.0, 0.0])))
    assert o.size_px[0] == pytest.approx(20.0 * 2.0**0.05)
    assert o.usual_score == 0.8
    doubles.tracks.step(scene(4))
    assert o.usual_score == pytest.approx(0.82)


def test_a_region_around_an_object_without_one_becomes_its_region() -> None:
    doubles = Doubles()
    o = doubles.confirmed_object()
    doubles.chosen = -1
    doubles.tracks.step(scene(3, BOX + np.array([-10.0, 10.0, -10.0, 10.0])))
    assert o.region == 0
    assert o.unlike == 1
    doubles.tracks.step(scene(4, BOX + 40.0))  # elsewhere
    assert o.region == -1


def test_a_size_that_lasts_is_adopted_without_a_jump_of_the_velocity() -> None:
    doubles = Doubles()
    o = doubles.confirmed_object()
    doubles.score = 0.3
    o.unlike = 20
    box = BOX + np.array([0.0, 24.0, 0.0, 0.0])
    before = np.trace(o.states.covariances[0, :3, :3])
    doubles.seen.clear()
    doubles.tracks.step(scene(3, box))
    np.testing.assert_allclose(o.pixel, [82.0, 57.0], atol=1e-6)
    (correction,) = [inputs for inputs in doubles.seen if inputs.measured is not None]
    # The position may change by the distance of the middles; the rate is as certain as before.
    added = np.trace(correction.covariances[0, :3, :3]) - before
    assert added == pytest.approx(3.0 * (12.0 / 400.0) ** 2, rel=0.05)
